"""The example that asks a filter how wrong it is."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


def test_it_has_a_row_for_each_coordinate(capsys: pytest.CaptureFixture[str]) -> None:
    example = runpy.run_path(str(DOCS / "examples" / "filter_consistency.py"), run_name="example")
    example["main"](["--seeds", "2", "--begin", "2", "--until", "4"])
    rows = capsys.readouterr().out.splitlines()
    assert [r.split()[0] for r in rows[1:]] == ["N", "E", "D", "phi", "theta", "psi"]
    assert all("nan" not in r for r in rows)
