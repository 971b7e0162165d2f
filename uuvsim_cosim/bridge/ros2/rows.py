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
    """Places of the signals in a master's rows; `texts` are those of texts and bytes."""

    def __init__(self, columns: Sequence[Column], tick: Fraction) -> None:
        held: dict[str, list[int]] = {}
        for i, c in enumerate(columns):
            held.setdefault(f"{c.path}.{c.variable.name}", []).append(i)
        self.columns, self.tick = columns, tick
        every = {
            name: np.array(at) if columns[at[0]].index is not None else np.array(at[0])
            for name, at in held.items()
        }
        texts = {name for name, at in held.items() if columns[at[0]].type.is_blob}
        # Columns side by side are read without a copy.
        self.spans = {
            name: slice(at[0], at[-1] + 1)
            for name, at in held.items()
            if every[name].ndim and at[-1] - at[0] == len(at) - 1
        }
        self.places = {name: at for name, at in every.items() if name not in texts}
        self.texts = {name: at for name, at in every.items() if name in texts}
        self.types = {name: columns[int(at.flat[0])].type for name, at in self.places.items()}
        self.dtypes = {
            name: None if type_ == Type.Boolean else np.dtype(type_.dtype)
            for name, type_ in self.types.items()
        }

    @property
    def variables(self) -> Mapping[str, Variable]:
        """The signals that are numbers, with their kind and size."""
        return {
            name: Variable(_kind(self.types[name]), at.size if at.ndim else 0)
            for name, at in self.places.items()
        }

    @property
    def names(self) -> list[str]:
        """The signals, texts included."""
        return [*self.places, *self.texts]

    def rows(self, ticks: Array, rows: Array, texts: Mapping[str, Array] | None = None) -> Rows:
        """Return rows as a block; `texts` (n, size) are those of the same rows."""
        return Rows(self, ticks, rows, texts or {})

    def row(self, time: float, values: Mapping[str, object]) -> Block:
        """Return a block of one row from the values of the signals."""
        return _Row(np.array([time]), {
            name: np.asarray(values[name]).reshape(1, *([at.size] if at.ndim else []))
            for name, at in {**self.places, **self.texts}.items()
        })  # fmt: skip


@final
class Rows:
    """Some rows of a layout; see `Block`."""

    def __init__(
        self, layout: Layout, ticks: Array, rows: Array, texts: Mapping[str, Array]
    ) -> None:
        self._layout, self._rows, self._texts = layout, rows, texts
        self._ticks, self.time = ticks, seconds(ticks, layout.tick)

    @property
    def last(self) -> Rows:
        """The last row alone."""
        texts = {name: t[-1:] for name, t in self._texts.items()}
        return Rows(self._layout, self._ticks[-1:], self._rows[-1:], texts)

    def __getitem__(self, name: str) -> Array:
        """Return a signal, which may be a view of the rows."""
        if name in self._texts:
            return self._texts[name]
        places = self._layout.spans.get(name, self._layout.places[name])
        slots, dtype = self._rows[:, places], self._layout.dtypes[name]
        return slots.astype(bool) if dtype is None else slots.view(dtype)

    def __contains__(self, name: object) -> bool:
        """Return whether there is a signal."""
        return name in self._layout.places


class _Row(dict[str, Array]):
    """Values of one row; see `Block`."""

    def __init__(self, time: Array, values: Mapping[str, Array]) -> None:
        super().__init__(values)
        self.time = time


def _kind(type_: Type) -> str:
    return "b" if type_ == Type.Boolean else type_.dtype[0]
