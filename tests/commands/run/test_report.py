"""`uuvsim report` of one run, of two, and as a picture."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.view.scene_parts import survey_signals
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
from uuvsim_cosim.view.recorded.traces import traces_of


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Recordings of two runs that were made by hand."""
    files = [tmp_path_factory.mktemp("runs") / f"{name}.mcap" for name in ("first", "second")]
    for file in files:
        write_mcap(survey_signals(), file)
    return [str(file) for file in files]


def test_one_run_gets_a_report(runs: list[str], tmp_path: Path) -> None:
    out = tmp_path / "report.html"
    assert status_of(["report", runs[0], "-o", str(out)]) == 0
    assert "Depth" in out.read_text(encoding="utf-8")


def test_two_runs_get_a_comparison(runs: list[str], tmp_path: Path) -> None:
    out = tmp_path / "both.html"
    assert status_of(["report", *runs, "-o", str(out)]) == 0
    page = out.read_text(encoding="utf-8")
    assert "first.mcap and second.mcap" in page
    assert "Depth: B − A" in page


def test_a_comparison_is_written_into_the_folder_of_the_first_run(
    runs: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "uuvsim_cosim.view.reports.run_comparison.sampled_traces"
    monkeypatch.setattr(name, lambda folder: traces_of(runs[0]))
    assert status_of(["report", str(tmp_path / "a"), str(tmp_path / "b")]) == 0
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["compared_with_b.html"]


def test_a_picture_of_a_run_is_written_into_a_folder_that_is_new(
    runs: list[str], tmp_path: Path
) -> None:
    out = tmp_path / "figures" / "track.svg"
    assert status_of(["report", runs[0], "-o", str(out)]) == 0
    assert out.read_text(encoding="utf-8").startswith("<svg")


def test_a_picture_of_two_runs_is_refused(
    runs: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["report", *runs, "-o", "both.svg"]) == 2
    assert "a picture shows one run" in capsys.readouterr().err
