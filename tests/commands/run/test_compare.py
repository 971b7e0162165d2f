"""`uuvsim compare`: the first difference as a sentence, every one in the table, status 1."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.orchestrator.running.run import run

PARTS = Path(__file__).parents[2] / "bridge" / "parts.py"


@pytest.fixture
def runs(tmp_path: Path) -> tuple[str, str]:
    """Two runs, which differ in an input."""
    system = uuv.System("sums", "0.1").add("sum", f"{PARTS}:Sum")
    one = run(system, until=1.0, out=tmp_path / "a", backend="native")
    two = run(system.set("sum.a", 3.0), until=1.0, out=tmp_path / "b", backend="native")
    return str(one.folder), str(two.folder)


def test_two_runs_that_differ_have_a_table_of_differences(
    runs: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["compare", *runs]) == 1
    text = capsys.readouterr().out
    assert " differs first, at t = 0" in text
    assert "first at [s]" in text


def test_equal_runs_have_none(runs: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of(["compare", runs[0], runs[0]]) == 0
    assert "first at [s]" not in capsys.readouterr().out
    assert status_of(["compare", runs[0], runs[0], "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["equal"], answer["differences"], answer["first"]) == (True, [], None)
