"""Playback of a recording like a running system: it is stepped, paused and read, and can be sought.

Signals have a value at each communication point; between two recorded points, the earlier value
holds. Nothing can be set. The whole recording is kept in memory.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn, final

import numpy as np

from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.fmus.description import Description, Variable, VariableType
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column, Observer
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.recording.recording_reader import PARQUET, STREAM, read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["Playback", "Stepped", "is_recording"]

_ENDINGS = (".mcap", ".parquet", ".arrows")
_TYPES: dict[str, VariableType] = {"f": "Float64", "i": "Int64", "u": "UInt64", "b": "Boolean"}


def is_recording(system: object) -> bool:
    """Return whether a path names a recording: .mcap, .parquet, .arrows, or the folder of a run."""
    if not isinstance(system, str | Path):
        return False
    path = Path(system).expanduser()
    if path.suffix.lower() in _ENDINGS:
        return True
    return any((path / name).is_file() for name in (PARQUET, STREAM))


@final
class Playback:
    """A recording instead of a master; raises RecordingError for other data."""

    def __init__(self, recording: Signals | Path | str) -> None:
        if isinstance(recording, Signals):
            signals, where = recording, "recording"
        else:
            path = Path(recording).expanduser()
            signals, where = read_signals(path), str(path)
        if not len(signals) or not len(signals.ticks):
            raise RecordingError(where, "contains no values", "a recording of a run")
        if np.any(np.diff(signals.ticks) <= 0):
            raise RecordingError(where, "its ticks do not grow", "those of one run")
        self.signals = signals
        named = str(signals.metadata.get("system") or Path(where).stem)
        self.name = re.sub(r"[^\w.-]+", "_", named) or "recording"
        self.plan = _plan(signals, where)
        self.columns = [
            c
            for planned in self.plan.components
            for v in planned.description.variables.values()
            for c in Column.of(planned.path, v)
        ]
        self._observers: Sequence[Observer] = ()
        self._rows, self._texts = _rows(signals, self.columns)
        self._ticks = signals.ticks
        self.first_tick, self.last_tick = int(self._ticks[0]), int(self._ticks[-1])
        self._tick = self.first_tick

    # ---- position -------------------------------------------------------------------------

    @property
    def tick(self) -> int:
        """The communication point."""
        return self._tick

    @property
    def time(self) -> float:
        """The time [s]."""
        return float(self._tick * self.plan.tick)

    @property
    def described(self) -> dict[str, object]:
        """Return the fields of a recording in `describe`: its seed, its begin and end [s]."""
        time, seed = self.signals.time, self.signals.metadata.get("seed")
        return {"seed": seed, "replays": [float(time[0]), float(time[-1])]}

    # ---- moving ---------------------------------------------------------------------------

    def initialize(self, observers: Sequence[Observer] = ()) -> None:
        """Go to the beginning, and pass it to the observers."""
        self._observers = observers
        for observer in observers:
            observer.begin(self.plan, self.columns)
        self.restore(self.first_tick)

    def check_ahead(self, tick: int, call: str) -> None:
        """Refuse to go beyond the end."""
        if tick > self.last_tick:
            end = float(self.signals.time[-1])
            raise InputInvalid(
                call,
                f"to t = {float(tick * self.plan.tick):g} s",
                f"at most {end:g} s, where the recording ends",
            )

    def step(self, n: int = 1) -> None:
        """Go n communication points forward."""
        self.check_ahead(self._tick + n, "step")
        first = self._row(self._tick) + 1
        self._tick += n
        self._show(first, self._row(self._tick) + 1)

    def reset(
        self, seed: int | None = None, start: Mapping[str, Mapping[str, object]] | None = None
    ) -> None:
        """Go back to the beginning."""
        self.restore(self.first_tick)

    def snapshot(self) -> int:
        """Return the communication point."""
        return self._tick

    def restore(self, snapshot: int) -> None:
        """Go to a communication point."""
        self._tick = snapshot
        row = self._row(snapshot)
        self._show(row, row + 1)

    def sought(self, name: str) -> int | None:
        """Return the communication point of ``t=SECONDS``; None for another name."""
        if not name.startswith("t="):
            return None
        begin, end = float(self.signals.time[0]), float(self.signals.time[-1])
        try:
            time = float(name[2:])
        except ValueError:
            time = float("nan")
        if not isfinite(time) or not begin <= time <= end:
            raise InputInvalid(f"restore {name!r}", f"t={begin:g} to t={end:g}, in s")
        return int(Fraction(str(time)) // self.plan.tick)

    def terminate(self) -> None:
        """Do nothing: there is nothing to end."""

    def free(self) -> None:
        """Do nothing: there is nothing to free."""

    # ---- values ---------------------------------------------------------------------------

    def get(self, path: str, name: str) -> Any:
        """Read a value at the current communication point."""
        values = self.signals[f"{path}.{name}"]
        value = values[self._row(self._tick)]
        if isinstance(value, np.ndarray):
            return value.copy()
        return value.item() if isinstance(value, np.generic) else value

    def fitted(self, path: str, name: str, value: object) -> NoReturn:
        """Raise InputInvalid: a recorded value cannot be set."""
        raise InputInvalid(
            f"{path}.{name}",
            "cannot be set, because the server replays a recording",
            "a running system, such as by `uuvsim serve SYSTEM`",
        )

    def set(self, path: str, name: str, value: object) -> None:
        """Raise InputInvalid: a recorded value cannot be set."""
        self.fitted(path, name, value)

    # ---- inside ---------------------------------------------------------------------------

    def _row(self, tick: int) -> int:
        """Return the last row that was recorded at or before a tick."""
        return int(np.searchsorted(self._ticks, tick, "right")) - 1

    def _show(self, begin: int, end: int) -> None:
        """Pass rows to the observers."""
        if end <= begin or not self._observers:
            return
        ticks, rows = self._ticks[begin:end], self._rows[begin:end]
        chunk = Chunk(self.columns, self.plan.tick, ticks, rows, self._texts)
        for observer in self._observers:
            observer.observe(chunk)


Stepped = Master | Playback
"""A master, or a recording that is stepped like one."""


def _plan(signals: Signals, where: str) -> Plan:
    """Return a plan whose components have the recorded signals as outputs."""
    try:
        tick = Fraction(str(signals.metadata["tick"]))
        if tick <= 0:
            raise ValueError
    except (KeyError, ValueError, ZeroDivisionError):
        raise RecordingError(
            where,
            f"its tick is {signals.metadata.get('tick')!r}",
            "that of a run, as `uuvsim run` and `uuvsim export` write",
        ) from None
    groups: dict[str, dict[str, Variable]] = {}
    for name, values in signals.items():
        path, _, variable = name.rpartition(".")
        units = signals.element_units.get(name) or (signals.units.get(name, ""),)
        same = len(set(units)) == 1
        if values.dtype.kind != "O":
            type_ = _TYPES[values.dtype.kind]
        else:
            type_ = "Binary" if values.size and isinstance(values.flat[0], bytes) else "String"
        groups.setdefault(path, {})[variable] = Variable(
            name=variable,
            type=type_,
            causality="output",
            variability="discrete",
            shape=values.shape[1:],
            unit=(units[0] or None) if same else None,
            description=signals.descriptions.get(name, ""),
            element_units=() if same else tuple(u or None for u in units),
        )
    components = tuple(
        PlannedComponent(
            path,
            f"recording:{where}",
            Description(path.rpartition(".")[2], "native", variables),
        )
        for path, variables in groups.items()
    )
    return Plan(tick, components, (), (), ())


def _rows(signals: Signals, columns: Sequence[Column]) -> tuple[np.ndarray, list[bytes]]:
    """Return the values in the format of a master's rows, and the texts that these refer to."""
    rows = np.zeros((len(signals.ticks), len(columns)), np.uint64, "F")
    texts: dict[bytes, int] = {}
    for i, c in enumerate(columns):
        whole = signals[f"{c.path}.{c.variable.name}"]
        values = whole if c.index is None else whole[:, c.index - 1]
        if c.type.is_blob:
            data = [v if isinstance(v, bytes) else str(v).encode() for v in values]
            rows[:, i] = [texts.setdefault(one, len(texts)) for one in data]
        elif c.type.name == "Boolean":
            rows[:, i] = values
        else:
            rows[:, i] = np.ascontiguousarray(values, c.type.dtype).view(np.uint64)
    return rows, list(texts)
