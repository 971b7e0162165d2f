"""`uuvsim report` of one run, of two, and as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.view.scene_parts import survey_signals
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.orchestrator.recording.parquet import write_parquet


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of two runs with recordings that were made by hand."""
    folders = [tmp_path_factory.mktemp("runs") / name for name in ("first", "second")]
    for folder in folders:
        folder.mkdir()
        write_parquet(survey_signals(), folder / "signals.parquet")
    return folders


def test_one_run_gets_a_report_in_its_folder(runs: list[Path]) -> None:
    assert status_of(["report", str(runs[0])]) == 0
    assert "Depth" in (runs[0] / "report.html").read_text(encoding="utf-8")


def test_two_runs_get_a_comparison_in_the_folder_of_the_first(runs: list[Path]) -> None:
    assert status_of(["report", *map(str, runs)]) == 0
    page = (runs[0] / "compared_with_second.html").read_text(encoding="utf-8")
    assert "first and second" in page
    assert "Depth: B − A" in page


def test_a_picture_of_a_run_is_written_into_a_folder_that_is_new(runs: list[Path]) -> None:
    out = runs[0] / "figures" / "track.svg"
    assert status_of(["report", str(runs[0]), "-o", str(out)]) == 0
    assert out.read_text(encoding="utf-8").startswith("<svg")


def test_a_picture_of_two_runs_is_refused(
    runs: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["report", *map(str, runs), "-o", "both.svg"]) == 2
    assert "a picture shows one run" in capsys.readouterr().err
