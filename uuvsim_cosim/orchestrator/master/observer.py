"""Observers of a run: they receive its rows from the stepping loop, and cannot change anything."""

from __future__ import annotations

import threading

# The functions of the module `signal` convert to enumerations, which takes some 20 µs a call.
from _signal import getsignal, signal  # type: ignore[import-not-found]
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from signal import SIGINT
from types import FrameType
from typing import Protocol

import numpy as np

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.master.core import Core
from uuvsim_cosim.orchestrator.master.core_library import Type
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Chunk", "Column", "Observer", "Rows", "Watch", "rows_of", "seconds", "uninterrupted"]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer Ctrl-C until the end of the block; Python raises it in the main thread only."""
    before = getsignal(SIGINT)
    main = threading.current_thread() is threading.main_thread()
    if not main or not callable(before):
        yield
        return
    caught: list[tuple[int, FrameType | None]] = []
    signal(SIGINT, lambda number, frame: caught.append((number, frame)))
    try:
        yield
    finally:
        signal(SIGINT, before)
        if caught:
            before(*caught[0])


@dataclass(frozen=True)
class Column:
    """One scalar of the rows; `index` of its element is from 1, None for a scalar variable."""

    path: str
    variable: Variable
    index: int | None

    @property
    def name(self) -> str:
        """Return ``path.variable`` or ``path.variable[i]``."""
        name = f"{self.path}.{self.variable.name}"
        return name if self.index is None else f"{name}[{self.index}]"

    @property
    def type(self) -> Type:
        """Return the type of its values."""
        return Type.of(self.variable)

    @staticmethod
    def of(path: str, variable: Variable) -> list[Column]:
        """List the columns of a variable."""
        if not variable.shape:
            return [Column(path, variable, None)]
        return [Column(path, variable, i + 1) for i in range(variable.size)]


@dataclass(frozen=True)
class Rows:
    """All rows in the buffer, `ticks` (n,) and `slots` (n, columns); a chunk's rows are the last.

    They do not change after `observe`, unless `reused`: then the buffer is full, and it is
    overwritten once `observe` has returned.
    """

    ticks: np.ndarray
    slots: np.ndarray
    reused: bool


@dataclass(frozen=True)
class Chunk:
    """Rows at consecutive communication points; valid only while `observe` runs.

    `ticks` (n,) of `tick` [s] each; `rows` (n, columns) holds slots of 8 bytes, column by column,
    which `values` reads; a text is an index into `texts`. `held` stays valid longer (see `Rows`).
    """

    columns: Sequence[Column]
    tick: Fraction
    ticks: np.ndarray
    rows: np.ndarray
    texts: Sequence[bytes]
    held: Rows | None = None

    @property
    def time(self) -> np.ndarray:
        """Return the times of the rows, (n,) [s]."""
        return seconds(self.ticks, self.tick)

    def values(self, i: int) -> np.ndarray:
        """Return column i: float64, int64, uint64, bool, or objects (str, bytes)."""
        type_ = self.columns[i].type
        raw = self.rows[:, i]
        if type_.is_blob:
            data = [self.texts[k] for k in raw]
            is_text = type_ == Type.String
            values = np.empty(len(data), object)
            values[:] = [d.decode(errors="replace") for d in data] if is_text else data
            return values
        return raw.astype(bool) if type_ == Type.Boolean else raw.view(type_.dtype)


def seconds(ticks: np.ndarray, tick: Fraction) -> np.ndarray:
    """Return times from integers, rounded once."""
    return (ticks * tick.numerator).astype(float) / float(tick.denominator)


class Observer(Protocol):
    """Receiver of a master's rows. Calls are made between steps, at most about 0.2 s apart."""

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Get the columns of the rows, before the first row."""

    def observe(self, chunk: Chunk) -> None:
        """Get the rows since the last call; copy those that are to be kept."""

    def end(self) -> None:
        """Close; called once, also after a failure."""


_ROWS, _BYTES = 32768, 1 << 22  # of a batch of the recording, at most; at least 512 rows


def rows_of(columns: int) -> int:
    """Return the number of rows to allocate memory for."""
    return 1 if columns == 0 else max(512, min(_ROWS, _BYTES // (8 * (columns + 1))))


class Watch:
    """Observers of one run: `begin`, rows, then `end` once, also after a failure.

    An observer whose `begin` raised is closed as well, as it may have opened a file by then.
    """

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
            # Noted before the observers are called: one that fails does not get rows a second time.
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
