"""`uuvsim run MODEL.fmu`: what a run that fails leaves."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from uuvsim_cosim.cli import status_of


def test_a_table_ends_with_csv(
    first_order_fmi2: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.docx"
    assert status_of(["run", str(first_order_fmi2), "--until", "1", "-o", str(out)]) == 2
    assert "ending '.docx' was read; expected .csv" in capsys.readouterr().err
    assert not out.exists()


def test_the_values_before_a_failure_are_kept_and_named(
    first_order_fmi2: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.csv"
    options = ["--until", "1", "--step", "0.1", "--set", "fault=1", "--set", "fault_time=0.5"]
    assert status_of(["run", str(first_order_fmi2), *options, "-o", str(out)]) == 3
    said = "".join(capsys.readouterr())
    assert f"the values up to that time are in {out}" in said
    assert "failed at t = 0.6 s: y is not finite" in said
    with out.open(newline="") as file:
        times = [float(row["time"]) for row in csv.DictReader(file)]
    assert times[-1] == 0.5
