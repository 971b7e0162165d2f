"""Rows of the master as blocks of signals by name, with the elements of an array together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Protocol, final

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.topics import Variable
from uuvsim_cosim.orchestrator.master.core_library import Type
from uuvsim_cosim.orchestrator.master.observer import Column, seconds

__all__ = ["Block", "Layout", "Rows"]


class Block(Protocol):
    """Rows of signals: `time` (n,) [s], and (n,) or (n, size) for a name."""

    @property
    def time(self) -> Array:
        """Times [s]."""

    def __getitem__(self, name: str, /) -> Array:
        """Return a signal."""

    def __contains__(self, name: object, /) -> bool:
        """Return whether there is a signal."""


@final
class Layout:
    """Places of the signals in a master's rows; `texts` are the columns without numbers."""

    def __init__(self, columns: Sequence[Column], tick: Fraction) -> None:
        held: dict[str, list[int]] = {}
        for i, c in enumerate(columns):
            if not c.type.is_blob:
                held.setdefault(f"{c.path}.{c.variable.name}", []).append(i)
        self.texts = [i for i, c in enumerate(columns) if c.type.is_blob]
        self.columns, self.tick = columns, tick
        self.places = {
            name: np.array(at) if columns[at[0]].index is not None else np.array(at[0])
            for name, at in held.items()
        }

    @property
    def variables(self) -> Mapping[str, Variable]:
        """The signals that are numbers, with their kind and size."""
        return {
            name: Variable(_kind(self.columns[int(at.flat[0])].type), at.size if at.ndim else 0)
            for name, at in self.places.items()
        }

    def rows(self, ticks: Array, rows: Array) -> Rows:
        """Return rows as a block."""
        return Rows(self, ticks, rows)


@final
class Rows:
    """Some rows of a layout; see `Block`."""

    def __init__(self, layout: Layout, ticks: Array, rows: Array) -> None:
        self._layout, self.ticks, self._rows = layout, ticks, rows
        self.time = seconds(ticks, layout.tick)

    def __getitem__(self, name: str) -> Array:
        """Return a signal."""
        at = self._layout.places[name]
        type_, slots = self._layout.columns[int(at.flat[0])].type, self._rows[:, at]
        return slots.astype(bool) if type_ == Type.Boolean else slots.view(type_.dtype)

    def __contains__(self, name: object) -> bool:
        """Return whether there is a signal."""
        return name in self._layout.places


def _kind(type_: Type) -> str:
    return "b" if type_ == Type.Boolean else type_.dtype[0]
