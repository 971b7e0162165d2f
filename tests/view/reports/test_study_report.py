"""The report of a study: which runs its pictures show, and how many rows it leaves out."""

from __future__ import annotations

import itertools
import re
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.view.reports.study_report import MOST_SCATTERS, study_html
from uuvsim_cosim.view.reports.study_report import _along as along

NAMES = [f"p{k}" for k in range(MOST_SCATTERS + 2)]
RUNS = 40


def parameter(name: str, kind: str) -> dict[str, Any]:
    return {"name": name, "kind": kind, "unit": "m"}


def interval(point: int, std: float) -> dict[str, Any]:
    found = {"mean": 1.0 + point, "low": 0.5 + point, "high": 1.5 + point, "std": std}
    return {"metric": "error", "point": point, "at": {"depth": 10.0 * point}, "n": 20, **found}


def report(failures: int = 0) -> str:
    """Two grid points of 20 runs; the metric varies more in the second."""
    about = {
        "name": "a study", "system": "tank", "duration": 5.0, "runs": RUNS, "failed": failures,
        "remarks": [], "asked": {"seeds": 20}, "intervals": [interval(0, 0.1), interval(1, 0.4)],
        "metrics": [{"name": "error", "unit": "m", "expression": "max(e)"}],
        "parameters": [parameter("depth", "grid"), *(parameter(n, "drawn") for n in NAMES)],
        "rank correlation": {"error": {n: 0.1 * k for k, n in enumerate(NAMES)}},
    }  # fmt: skip
    point = np.repeat([0, 1], 20)
    drawn = {n: np.linspace(0.0, 1.0 + k, RUNS) for k, n in enumerate(NAMES)}
    columns = {"point": point, "seed": np.arange(RUNS) % 20, "depth": 10.0 * point,
               "error": np.linspace(0.0, 2.0, RUNS), **drawn}  # fmt: skip
    stopped = ["a thruster failed" if k < failures else None for k in range(RUNS)]
    return study_html(about, columns, stopped)


def test_the_parameters_of_greatest_rank_correlation_are_drawn_and_the_others_counted() -> None:
    page = report()
    drawn = re.findall(r"against (p\d+), rank correlation \+(\S+?)<", page)
    assert [name for name, _ in drawn] == NAMES[:1:-1]
    assert "2 more parameters have less rank correlation" in page


def test_dots_are_the_runs_of_the_grid_point_where_the_metric_varies_most() -> None:
    page = report()
    assert "Dots show the runs at depth = 10 m" in page
    assert "mean with 95 % interval" in page


@pytest.mark.parametrize(("axes", "words"), [(1, ""), (2, ""), (3, ", over 1 other axes")])
def test_means_over_further_axes_of_the_grid_are_named(axes: int, words: str) -> None:
    names = ["depth", "speed", "load"][:axes]
    row = {"metric": "error", "point": 0, "n": 20, "mean": 1.0, "low": 0.5, "high": 1.5, "std": 0.1}
    points = [
        dict(zip(names, at, strict=True)) for at in itertools.product((1.0, 2.0), repeat=axes)
    ]
    about = {"intervals": [{**row, "at": at} for at in points]}
    drawn = along("error", "m", about, [parameter(n, "grid") for n in names])
    assert f">mean with 95 % interval{words} <" in re.sub(r"\s*<", " <", drawn)


def test_twenty_failures_are_listed_and_the_others_counted() -> None:
    page = report(failures=25)
    assert page.count("a thruster failed") == 20
    assert "<p>and 5 more, in runs.parquet</p>" in page
    assert report(failures=20).count("a thruster failed") == 20
    assert "in runs.parquet" not in report(failures=20)
