"""Observers of a run: they receive its rows, and cannot change anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol

import numpy as np

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.master.core import Type
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Chunk", "Column", "Observer", "Rows", "seconds"]


@dataclass(frozen=True)
class Column:
    """One scalar of the rows; `index` counts from 1, None for a scalar variable."""

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
    """All rows since there was free room; they stay as they are until `reused` says so.

    `ticks` (n,) and `slots` (n, columns), of which a chunk's are the end. Where `reused`, the
    memory is written over once `observe` has returned.
    """

    ticks: np.ndarray
    slots: np.ndarray
    reused: bool


@dataclass(frozen=True)
class Chunk:
    """Rows at consecutive communication points; valid only while `observe` runs.

    `ticks` (n,) of `tick` [s] each; `rows` (n, columns) holds slots of 8 bytes, column by column,
    which `values` reads; a text is an index into `texts`. `held` lasts longer.
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
            kept: list[Any] = [self.texts[k] for k in raw]
            if type_ == Type.String:
                kept = [data.decode(errors="replace") for data in kept]
            values = np.empty(len(kept), object)
            values[:] = kept
            return values
        return raw.astype(bool) if type_ == Type.Boolean else raw.view(type_.dtype)


def seconds(ticks: np.ndarray, tick: Fraction) -> np.ndarray:
    """Return times from integers, rounded once."""
    return (ticks * tick.numerator).astype(float) / float(tick.denominator)


class Observer(Protocol):
    """Watches one master; every call happens between steps, at most about 0.2 s apart."""

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Learn what the rows will hold, before the first."""

    def observe(self, chunk: Chunk) -> None:
        """See the rows since the last call; copy what is to be kept."""

    def end(self) -> None:
        """Close; also called after a failure, once."""
