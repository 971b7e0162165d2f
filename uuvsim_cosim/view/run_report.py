"""The report and the picture of a run, from its folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.traces import Traces

__all__ = ["provenance_of", "traces_of", "write_report", "write_run_picture"]


def traces_of(folder: str | Path) -> Traces:
    """Give the numeric signals of a run; raises RecordingError if there is no recording."""
    from uuvsim_cosim.orchestrator.recording import read_signals

    signals = read_signals(folder)
    numbers = {
        name: np.asarray(value, dtype=float)
        for name, value in signals.items()
        if value.dtype.kind in "fiub"
    }
    return Traces(signals.time, numbers, signals.units)


def provenance_of(folder: str | Path) -> dict[str, Any]:
    """Give what run.json says; nothing if there is none (a run that was killed)."""
    path = Path(folder) / "run.json"
    if not path.is_file():
        return {"system": Path(folder).resolve().name}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputInvalid(f"{path}: cannot be read ({error}); expected a run's JSON") from None
    if not isinstance(found, dict):
        raise InputInvalid(f"{path}: holds a {type(found).__name__}; expected a run's JSON object")
    return found


def write_report(folder: str | Path, out: str | Path | None = None) -> Path:
    """Write the one-file report of a run, by default report.html in its folder."""
    from uuvsim_cosim.scene.mapping import read_map
    from uuvsim_cosim.view.report import report_html
    from uuvsim_cosim.view.stage_run import stage_of_run

    traces = _some(traces_of(folder), folder)
    surveyed = read_map(Path(folder))
    page = report_html(traces, provenance_of(folder), stage_of_run(folder, traces), surveyed)
    return _written(Path(out) if out is not None else Path(folder) / "report.html", page)


def write_run_picture(folder: str | Path, out: str | Path) -> Path:
    """Write a run as one static SVG, for a README or a paper."""
    from uuvsim_cosim.view.picture import picture_svg

    page = picture_svg(_some(traces_of(folder), folder), provenance_of(folder))
    return _written(Path(out), page)


def _some(traces: Traces, folder: str | Path) -> Traces:
    if len(traces.time) < 2:
        raise InputInvalid(f"{folder}: {len(traces.time)} sample(s) recorded; expected 2 or more")
    return traces


def _written(path: Path, text: str) -> Path:
    scratch = path.with_name(f".{path.name}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch.write_text(text, encoding="utf-8")
        scratch.replace(path)
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None
    return path
