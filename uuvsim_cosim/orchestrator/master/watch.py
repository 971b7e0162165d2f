"""Passing of recorded rows from the stepping loop to the observers of one master."""

from __future__ import annotations

from collections.abc import Sequence

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.orchestrator.master.core import Core
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column, Observer, Rows
from uuvsim_cosim.orchestrator.master.uninterrupted import uninterrupted
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Watch", "rows_of"]

_ROWS, _BYTES = 32768, 1 << 22  # of a batch of the recording, at most; at least 512 rows


def rows_of(columns: int) -> int:
    """Return the number of rows to allocate memory for."""
    return 1 if columns == 0 else max(512, min(_ROWS, _BYTES // (8 * (columns + 1))))


class Watch:
    """Observers of one run: `begin`, rows, then `end` once, also after a failure."""

    def __init__(self, plan: Plan, observers: Sequence[Observer]) -> None:
        self._plan = plan
        self.observers = list(observers)
        self._columns: Sequence[Column] = ()
        self._open: list[Observer] = []
        self._shown: tuple[Core | None, int] = (None, 0)  # rows of that core passed on already

    def begin(self, columns: Sequence[Column]) -> None:
        """Announce the columns to all observers."""
        self._columns = columns
        for observer in self.observers:
            self._open.append(observer)
            observer.begin(self._plan, columns)

    def emit(self, core: Core) -> None:
        """Pass on the rows that the core has written, and clear its buffer when it is full."""
        if not self._columns:
            return
        with uninterrupted():  # so that no row is lost or passed on twice
            shown = self._shown[1] if self._shown[0] is core else 0
            ticks, rows, texts = core.rows()
            full = core.is_full
            self._shown = (core, 0 if full else len(ticks))
            try:
                if len(ticks) > shown:
                    held = Rows(ticks, rows, full)
                    ticks, rows = ticks[shown:], rows[shown:]
                    chunk = Chunk(self._columns, self._plan.tick, ticks, rows, texts, held)
                    for observer in self._open:
                        observer.observe(chunk)
            finally:
                if full:
                    core.clear_rows()

    def end(self) -> None:
        """Close all observers, then raise the first error."""
        closing, self._open = self._open, []
        first: UuvsimError | None = None
        for observer in closing:
            try:
                observer.end()
            except UuvsimError as error:
                first = first or error
        if first is not None:
            raise first
