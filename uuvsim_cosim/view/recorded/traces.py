"""Traces: the recorded signals of a run by name, with elements joined to vectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.declaration.element_names import split_element_name

__all__ = ["Array", "Traces", "joined"]

Array = NDArray[np.float64]


def joined(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return vectors for columns named x[1] … x[n]; other columns stay as they are."""
    groups: dict[str, dict[tuple[int, ...], Array]] = {}
    values: dict[str, Array] = {}
    for name, column in columns.items():
        whole, indices = split_element_name(name)
        if indices:
            groups.setdefault(whole, {})[indices] = np.asarray(column, dtype=float)
        else:
            values[name] = np.asarray(column, dtype=float)
    for name, elements in groups.items():
        values[name] = np.column_stack([elements[i] for i in sorted(elements)])
    return values


@dataclass(frozen=True)
class Traces:
    """Time (T,) [s] and values by ``component.variable``, shape (T,) or (T, n), SI and rad."""

    time: Array
    values: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)

    def find(self, name: str) -> Array | None:
        """Return a signal by name, or by the end of a nested name (``rov.hull.eta``) if unique."""
        if name in self.values:
            return self.values[name]
        nested = [key for key in self.values if key.endswith("." + name)]
        return self.values[nested[0]] if len(nested) == 1 else None

    def vector(self, name: str, size: int) -> Array | None:
        """Return the first `size` elements of a signal, shape (T, size), or None."""
        value = self.find(name)
        if value is None or value.ndim != 2 or value.shape[1] < size:
            return None
        return value[:, :size]

    def scalar(self, name: str) -> Array | None:
        """Return a signal of one element, shape (T,), or None."""
        value = self.find(name)
        if value is None:
            return None
        if value.ndim == 2:
            return value[:, 0] if value.shape[1] == 1 else None
        return value
