"""Reader of a run's folder for reports and pictures: its signals, and its run.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.view.recorded.traces import Traces

__all__ = ["provenance_of", "traces_of"]


def traces_of(folder: str | Path) -> Traces:
    """Return the numeric signals of a run; raises RecordingError if there is no recording."""
    signals = read_signals(folder)
    numbers = {
        name: np.asarray(value, dtype=float)
        for name, value in signals.items()
        if value.dtype.kind in "fiub"
    }
    return Traces(signals.time, numbers, signals.units)


def provenance_of(folder: str | Path) -> dict[str, Any]:
    """Return the content of run.json; only the system's name if the run was killed before."""
    path = Path(folder) / "run.json"
    if not path.is_file():
        return {"system": Path(folder).resolve().name}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputInvalid(path, f"cannot be read ({error})", "a run's JSON") from None
    if not isinstance(found, dict):
        raise InputInvalid(path, f"holds a {type(found).__name__}", "a run's JSON object")
    return found
