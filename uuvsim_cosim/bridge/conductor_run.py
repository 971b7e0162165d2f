"""A run that is under way: to an instant or on and on, as fast as can be or against the clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.conductor_calls import Answer
from uuvsim_cosim.bridge.conductor_names import Place
from uuvsim_cosim.bridge.stepped import Stepped
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.observer import Chunk, Column
from uuvsim_cosim.orchestrator.plan import Plan

__all__ = ["Record", "Running"]

_SECONDS = 0.01  # of wall time between two looks at the queue, when as fast as can be
_WAKES = 1000.0  # [1/s] at most: shorter ticks are stepped several at a time
_HOPELESS = 1.0  # [s] behind the clock, from which on the schedule moves instead


@final
class Record:
    """Signals of a run, one row a communication point; an observer of its rows."""

    def __init__(
        self,
        places: Mapping[str, Place],
        columns: Sequence[Column],
        read: Callable[[Place], Any],
    ) -> None:
        found = {(c.path, c.variable.name, c.index): i for i, c in enumerate(columns)}
        self._columns: dict[str, tuple[list[int], tuple[int, ...]]] = {}
        self._read, self._places = read, places
        self._others: dict[str, Place] = {}
        for name, place in places.items():
            v = place.variable
            elements = range(v.size) if place.element is None else [place.element]
            keys = [(place.path, v.name, e + 1 if v.shape else None) for e in elements]
            if all(key in found for key in keys):
                shape = v.shape if place.element is None else ()
                self._columns[name] = ([found[key] for key in keys], shape)
            else:
                self._others[name] = place
        self._time: list[np.ndarray] = []
        self._values: dict[str, list[np.ndarray]] = {name: [] for name in places}

    @property
    def each_step(self) -> bool:
        """Say whether values have to be read one step at a time: those that no row holds."""
        return bool(self._others)

    def first(self, time_: float) -> None:
        """Take the values where the run begins."""
        self._time.append(np.array([time_]))
        for name, place in self._places.items():
            self._values[name].append(np.array(self._read(place))[None])

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Nothing to learn: the columns are known."""

    def observe(self, chunk: Chunk) -> None:
        """Keep the rows."""
        n = len(chunk.ticks)
        self._time.append(np.array(chunk.time))
        for name, (columns, shape) in self._columns.items():
            values = np.stack([chunk.values(i) for i in columns], 1)
            self._values[name].append(values.reshape(n, *shape))
        for name, place in self._others.items():
            self._values[name].extend([np.array(self._read(place))[None]] * n)

    def end(self) -> None:
        """Nothing to close."""

    def taken(self) -> dict[str, np.ndarray]:
        """Give the time and the signals."""
        given = {"time": np.concatenate(self._time) if self._time else np.zeros(0)}
        for name, parts in self._values.items():
            given[name] = np.concatenate(parts) if parts else np.zeros(0)
        return given


@final
class Running:
    """Steps towards `end` (a tick; None: on and on), at `factor` of real time if that is given."""

    def __init__(
        self,
        master: Stepped,
        end: int | None,
        factor: float | None,
        answer: Answer | None,
        record: Record | None,
        finish: Callable[[], Any],
    ) -> None:
        if factor is not None and not 0.0 < factor < float("inf"):
            raise InputInvalid(f"run: factor {factor:g}; expected more than 0")
        self.answer, self.record, self.finish = answer, record, finish
        self.factor = factor
        self.overruns = 0
        self.busy = 0.0  # [s] of wall time in steps
        self._master, self._end = master, end
        self._first, self._begun = master.tick, time.perf_counter()
        self._period = 0.0 if factor is None else float(master.plan.tick) / factor
        self._each = max(1, ceil(1.0 / (_WAKES * self._period))) if self._period else 8
        if record is not None and record.each_step:
            self._each = 1

    @property
    def is_over(self) -> bool:
        """Say whether the end has been reached."""
        return self._end is not None and self._master.tick >= self._end

    @property
    def wait(self) -> float:
        """Give the time until the next step is due [s of wall time]."""
        if not self._period:
            return 0.0
        due = self._begun + (self._master.tick - self._first) * self._period
        return due - time.perf_counter()

    def advance(self) -> None:
        """Make the steps that are due now."""
        begun = time.perf_counter()
        n = self._each if self._end is None else min(self._each, self._end - self._master.tick)
        self._master.step(n)
        took = time.perf_counter() - begun
        self.busy += took
        if not self._period:
            if self.record is None or not self.record.each_step:
                wanted = int(self._each * _SECONDS / max(took, 1e-6))
                self._each = max(1, min(4 * self._each, wanted))
            return
        behind = -self.wait
        if behind > 0.0:
            self.overruns += 1
            if behind > _HOPELESS:
                self._begun += behind
