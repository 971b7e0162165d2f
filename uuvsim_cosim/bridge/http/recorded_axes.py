"""The source `axes:RUN`: the axes that a pilot had in a recorded run, at the same times again.

The set-points from which a client over MAVLink computed the axes are repeated as outputs.

A person, a page or MAVLink moves a vehicle by the axes of `keyboard`, which the recording contains
as the pilot's output `axes`. With them, a run repeats to the bit without these clients.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np

from uuvsim_cosim.bridge.http.keyboard import Piloted, piloted
from uuvsim_cosim.bridge.http.manual_axes import AXES, SetPoint
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.orchestrator.python.component import PythonComponent
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.system.resolve import register
from uuvsim_cosim.orchestrator.system.sources import Backend
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["RecordedAxesSource", "source", "with_recorded_axes"]

_Axes = tuple[float, float, float, float]
_Commands = tuple[_Axes, SetPoint]
_STILL: _Commands = (0.0, 0.0, 0.0, 0.0), SetPoint()


class Repeated(Piloted):
    """A pilot whose axes are those of a recording; after its end they are zero."""

    tick = 1.0  # [s]
    table: Mapping[int, _Commands] = {}  # by tick, at the end of the step

    def commands_at(self, t: float) -> _Commands:
        """Return the axes and the set-point of the step that ends at time t [s]."""
        return self.table.get(round(t / self.tick), _STILL)


def source(text: str, base: Path) -> RecordedAxesSource:
    """Resolve ``axes:RUN``; the entry point of the scheme."""
    path = base / Path(text.partition(":")[2]).expanduser()
    if not path.exists():
        raise InputInvalid(f"axes:{path}", "no such recording", "the folder of a run")
    return RecordedAxesSource(path.absolute())


@dataclass(frozen=True)
class RecordedAxesSource:
    """The axes of a recorded run instead of a person."""

    recording: Path
    kind: str = "axes"

    @property
    def text(self) -> str:
        """The source string."""
        return f"axes:{self.recording}"

    def describe(self) -> Description:
        """Return the interface."""
        return PythonComponent(Repeated, "axes").description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Repeat the axes of the component of the same path."""
        tick, table = _read(self.recording, path)
        return PythonComponent(type("Repeated", (Repeated,), {"tick": tick, "table": table}), path)


@cache
def _read(recording: Path, path: str) -> tuple[float, Mapping[int, _Commands]]:
    """Return the tick [s] and the commands by tick; raises RecordingError if they are incomplete.

    Recordings of earlier versions have no set-points.
    """
    signals = read_signals(recording)
    name = f"{path}.axes"
    if name not in signals:
        raise RecordingError(
            str(recording), f"has no signal {name}", "a run in which `keyboard` was this component"
        )
    if np.any(np.diff(signals.ticks) != 1):
        raise RecordingError(str(recording), "does not contain every step", "all steps of a run")
    rows = np.asarray(signals[name], float).reshape(-1, len(AXES)).tolist()
    setpoints = [SetPoint()] * len(rows)
    if f"{path}.setpoint_kind" in signals:
        mode, kind, pose, velocity = (
            np.asarray(signals[f"{path}.{name}"], float).tolist()
            for name in ("mode", "setpoint_kind", "setpoint_pose", "setpoint_velocity")
        )
        setpoints = [
            SetPoint(m, tuple(p) if k == 1.0 else None, tuple(v) if k == 2.0 else None)
            for m, k, p, v in zip(mode, kind, pose, velocity, strict=True)
        ]
    table: dict[int, _Commands] = {
        int(tick): (tuple(row), setpoint)
        for tick, row, setpoint in zip(signals.ticks, rows, setpoints, strict=True)
    }
    return _tick(signals.metadata, recording), table


def _tick(metadata: Mapping[str, object], recording: Path) -> float:
    try:
        return float(Fraction(str(metadata["tick"])))
    except (KeyError, ValueError, ZeroDivisionError):
        raise RecordingError(str(recording), "states no tick", "the folder of a run") from None


def with_recorded_axes(system: Callable[[], System], swaps: dict[str, str]) -> None:
    """Replace ``NAME: axes:RUN`` among swaps by the pilot that the name means.

    `system` loads the system, if there is such a swap. Raises InputInvalid if no pilot can be
    replaced, or if it moves the vehicle by the inputs of another component.
    """
    named = [name for name, text in swaps.items() if text.startswith("axes:")]
    if not named:
        return
    register("axes", source)
    loaded = system()
    for name in named:
        path, wanted = piloted(loaded, name)
        if wanted != "keyboard:":
            raise InputInvalid(
                f"--replace {name}={swaps[name]}",
                f"{path} is moved by its inputs a and omega, which are not recorded as axes",
                "a component with outputs eta_d and nu_d, or a and omega",
            )
        recording = Path(swaps.pop(name).partition(":")[2]).expanduser().absolute()
        swaps[path] = f"axes:{recording}"
