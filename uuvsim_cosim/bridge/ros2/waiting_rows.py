"""Rows of the running master that wait for another thread, which the stepping thread never copies.

The rows stay in the master's memory. Only when the master is about to use that memory again, the
rows that still wait are copied, as many as fit into `_BYTES`. A reader that was interrupted for
longer than the master needs to come round sees by `is_intact` that its rows have been overwritten.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Generic, TypeVar, final

from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.orchestrator.master.observer import Chunk, Rows

__all__ = ["Part", "WaitingRows"]

_ROWS = 64  # of a part at most: a run that is as fast as possible gives its newest rows
_BYTES = 8 << 20  # copied at most when the memory is used again

Run = TypeVar("Run")


@dataclass(frozen=True)
class Part(Generic[Run]):
    """Rows at consecutive communication points of a run; `turn` is None for copies."""

    run: Run
    ticks: Array
    slots: Array
    begin: int = 0
    turn: int | None = None


@final
class WaitingRows(Generic[Run]):
    """The rows that wait; `dropped` counts those that were lost because the reader was slow."""

    def __init__(self) -> None:
        self.dropped = 0
        self._lock = threading.Lock()
        self._run: Run | None = None
        self._held: Rows | None = None
        self._done = self._turn = 0  # rows read, and times that the memory was used again
        self._kept: list[Part[Run]] = []

    def add(self, run: Run, chunk: Chunk) -> None:
        """Note the rows of a chunk; the stepping thread calls this."""
        held = chunk.held or Rows(chunk.ticks, chunk.rows, reused=True)
        with self._lock:
            before = self._held
            if run is not self._run or before is None or before.slots.base is not held.slots.base:
                self._keep()
                self._run, self._done = run, len(held.ticks) - len(chunk.ticks)
            self._held = held
            if held.reused:
                self._keep(copied=True)
                self._held, self._done = None, 0
                self._turn += 1

    def take(self) -> list[Part[Run]]:
        """Return the rows that wait, oldest first; the reader calls this."""
        with self._lock:
            self._keep()
            taken, self._kept = self._kept, []
            return taken

    def is_intact(self, part: Part[Run]) -> bool:
        """Return whether the master has not overwritten the rows of a part."""
        with self._lock:
            if part.turn is None or part.turn == self._turn:
                return True
            used = 0 if self._held is None else len(self._held.ticks)
            return self._turn == part.turn + 1 and used <= part.begin

    def _keep(self, *, copied: bool = False) -> None:
        """Make a part of the rows that have not been read; those of copies are bounded by bytes."""
        held, run = self._held, self._run
        if held is None or run is None or self._done >= len(held.ticks):
            return
        most = _ROWS
        if copied:
            waiting = sum(p.slots.nbytes for p in self._kept if p.turn is None)
            row = max(1, held.slots.shape[1] * held.slots.itemsize)
            most = min(most, max(0, _BYTES - waiting) // row)
        begin = max(self._done, len(held.ticks) - most)
        self.dropped += begin - self._done
        self._done = len(held.ticks)
        ticks, slots = held.ticks[begin:], held.slots[begin:]
        if copied:
            self._kept.append(Part(run, ticks.copy(), slots.copy()))
        else:
            self._kept.append(Part(run, ticks, slots, begin, self._turn))
