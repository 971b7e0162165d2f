"""The picture of what a Jacobi step delays tells the truth: one step for each connection."""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def example() -> dict[str, Any]:
    return runpy.run_path(str(DOCS / "examples" / "jacobi_delay.py"), run_name="example")


@pytest.mark.parametrize(("algorithm", "each"), [("jacobi", 1), ("gauss-seidel", 0)])
def test_each_connection_delays_by_one_jacobi_step(
    example: dict[str, Any], algorithm: str, each: int, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    time, (source, *late) = example["signals"]("0.2", algorithm)
    assert np.allclose(source, np.sin(2 * np.pi * time / example["PERIOD"]), atol=1e-12)
    assert [example["delay"](source, y) for y in late] == [each, 2 * each, 3 * each]


def test_the_picture_shows_what_the_example_found() -> None:
    svg = (DOCS / "images" / "jacobi_delay.svg").read_text(encoding="utf-8")
    about = re.search(r"<dc:description>(.*?)</dc:description>", svg)
    assert about is not None
    found = [f"{a}, h = {h} s: {n} steps" for h in ("0.2", "0.05")
             for a, n in (("jacobi", "1, 2, 3"), ("gauss-seidel", "0, 0, 0"))]  # fmt: skip
    assert about[1] == "; ".join(found)
    page = (DOCS / "systems" / "time.md").read_text(encoding="utf-8")
    assert "(../images/jacobi_delay.svg)" in page
