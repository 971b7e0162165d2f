"""The report and the picture of a run, from its folder."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from uuvsim_cosim.cache import written
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.orchestrator.running.run_json import write_run_json
from uuvsim_cosim.scene.mapping.mapping import read_map
from uuvsim_cosim.view.recorded.metrics import Figure, metrics_of
from uuvsim_cosim.view.recorded.run_folder import provenance_of, traces_of
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.reports.picture import picture_svg
from uuvsim_cosim.view.reports.run_report_html import report_html
from uuvsim_cosim.view.scene3d.scene_of_run import scene3d_of_run

__all__ = ["write_metrics", "write_report", "write_run_picture"]


def write_metrics(folder: str | Path, figures: Iterable[Figure]) -> None:
    """Write figures of merit into run.json, as `metrics`: value, unit and label by key.

    Raises RecordingError if it cannot be written; the old file then stays.
    """
    path = Path(folder) / "run.json"
    try:
        write_run_json(path, {**provenance_of(folder), "metrics": metrics_of(figures)})
    except OSError as error:
        raise RecordingError(path, error.strerror, "room on the disk") from None


def write_report(folder: str | Path, out: str | Path | None = None) -> Path:
    """Write the one-file report of a run, by default report.html in its folder."""
    traces = _some(traces_of(folder), folder)
    surveyed = read_map(Path(folder))
    page = report_html(traces, provenance_of(folder), scene3d_of_run(folder, traces), surveyed)
    return written(
        Path(out) if out is not None else Path(folder) / "report.html", page, make_folder=True
    )


def write_run_picture(folder: str | Path, out: str | Path) -> Path:
    """Write a run as one static SVG, for a README or a paper."""
    page = picture_svg(_some(traces_of(folder), folder), provenance_of(folder))
    return written(Path(out), page, make_folder=True)


def _some(traces: Traces, folder: str | Path) -> Traces:
    if len(traces.time) < 2:
        raise InputInvalid(folder, f"{len(traces.time)} sample(s) recorded", "2 or more")
    return traces
