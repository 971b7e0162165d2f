"""Observers of a run: they receive its rows, and cannot change anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.master.core import Type
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Chunk", "Column", "Observer", "Rows", "seconds"]


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
