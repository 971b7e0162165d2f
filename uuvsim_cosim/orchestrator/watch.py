"""A master's observers: they are told of the columns, then given rows, then closed once."""

from __future__ import annotations

from collections.abc import Sequence

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.orchestrator.core import Core
from uuvsim_cosim.orchestrator.observer import Chunk, Column, Observer
from uuvsim_cosim.orchestrator.plan import Plan
from uuvsim_cosim.orchestrator.uninterrupted import uninterrupted

__all__ = ["Watch", "rows_of"]

_ROW_BYTES = 1 << 19  # stay in the cache of one core


def rows_of(columns: int) -> int:
    """Give the number of rows to make room for."""
    return max(64, min(65536, _ROW_BYTES // (8 * max(1, columns))))


class Watch:
    """The observers of one run; an observer that has begun is ended, whatever happens."""

    def __init__(self, plan: Plan, observers: Sequence[Observer]) -> None:
        self._plan = plan
        self.observers = list(observers)
        self._columns: Sequence[Column] = ()
        self._open: list[Observer] = []

    def begin(self, columns: Sequence[Column]) -> None:
        """Tell all of the columns."""
        self._columns = columns
        for observer in self.observers:
            self._open.append(observer)
            observer.begin(self._plan, columns)

    def emit(self, core: Core) -> None:
        """Give all the rows that the core has written, and make room for the next."""
        if not self._columns:
            return
        with uninterrupted():  # no row is lost or seen twice
            self._emit(core)

    def _emit(self, core: Core) -> None:
        ticks, rows, texts = core.rows()
        if len(ticks):
            chunk = Chunk(self._columns, self._plan.tick, ticks, rows, texts)
            for observer in self._open:
                observer.observe(chunk)
        core.clear_rows()

    def end(self) -> None:
        """Close all; raises the first error after that."""
        closing, self._open = self._open, []
        first: UuvsimError | None = None
        for observer in closing:
            try:
                observer.end()
            except UuvsimError as error:
                first = first or error
        if first is not None:
            raise first
