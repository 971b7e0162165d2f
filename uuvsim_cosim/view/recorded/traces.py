"""Traces: the recorded signals of a run by name, with elements joined to vectors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.orchestrator.recording.columns import LazyArrays, column
from uuvsim_cosim.orchestrator.recording.recording_reader import open_recording
from uuvsim_cosim.orchestrator.recording.samples import Array, Samples, element, picked

__all__ = ["Array", "Elements", "Traces", "joined", "provenance_of", "traces_of"]


@dataclass(frozen=True)
class Elements:
    """Elements of an array by their number, from 0; each is read when it is asked for."""

    traces: Traces
    name: str

    def __getitem__(self, k: int) -> Samples:
        """Return an element, shape (T,)."""
        return self.traces.element(self.name, k)

    def __len__(self) -> int:
        """Return the number of elements."""
        return self.traces.size(self.name)

    def stacked(self, *elements: int, rows: NDArray[np.intp]) -> Array:
        """Return some elements at some rows in ascending order, shape (rows, elements)."""
        return np.column_stack([picked(self[k], rows) for k in elements])


@dataclass(frozen=True)
class Traces:
    """Time (T,) [s] and values by ``component.variable``, shape (T,) or (T, n), SI and rad.

    `units` has one text for each signal ("m, rad" for a pose), `element_units` one unit for each
    element of a signal, where they are known.
    """

    time: Array
    values: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    element_units: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def size(self, name: str) -> int:
        """Return the number of elements of a signal."""
        if isinstance(self.values, LazyArrays):
            return self.values.size(name)
        return self.values[name].reshape(len(self.time), -1).shape[1] if len(self.time) else 0

    def find(self, name: str) -> Array | None:
        """Return a signal by name, or by the end of a nested name (``rov.hull.eta``) if unique."""
        full = self._full_name(name)
        return None if full is None else self.values[full]

    def _full_name(self, name: str) -> str | None:
        if name in self.values:
            return name
        nested = [key for key in self.values if key.endswith("." + name)]
        return nested[0] if len(nested) == 1 else None

    def elements(self, name: str, size: int) -> Elements | None:
        """Return the elements of an array of at least `size` ones, each read at its use, or None.

        The array is looked for as in `find`.
        """
        full = self._full_name(name)
        if full is None or self.size(full) < size or not self.is_array(full):
            return None
        return Elements(self, full)

    def element(self, name: str, k: int) -> Samples:
        """Return element `k`, from 0, of a signal by its whole name, shape (T,)."""
        return element(self.values, name, k, len(self.time))

    def is_array(self, name: str) -> bool:
        """Return whether a signal is an array, by its whole name."""
        if isinstance(self.values, LazyArrays):
            return self.values.is_array(name)
        return self.values[name].ndim == 2

    def scalar(self, name: str) -> Samples | None:
        """Return a signal of one element, shape (T,), or None."""
        full = self._full_name(name)
        return self.element(full, 0) if full is not None and self.size(full) == 1 else None

    def by_unit(self, name: str, most: int) -> list[tuple[str, list[int]]]:
        """Return the elements (from 0) of a signal in groups of one unit and at most `most`."""
        size = self.size(name)
        units = self.element_units.get(name, ())
        if len(units) != size:
            units = (self.units.get(name, ""),) * size
        return [
            (unit, elements[i : i + most])
            for unit in dict.fromkeys(units)
            for elements in [[k for k in range(size) if units[k] == unit]]
            for i in range(0, len(elements), most)
        ]


def joined(columns: Mapping[str, Array]) -> dict[str, Array]:
    """Return vectors for columns named x[1] … x[n]; other columns stay as they are."""
    groups: dict[str, dict[tuple[int, ...], Array]] = {}
    values: dict[str, Array] = {}
    for name, samples in columns.items():
        whole, indices = split_element_name(name)
        if indices:
            groups.setdefault(whole, {})[indices] = np.asarray(samples, dtype=float)
        else:
            values[name] = np.asarray(samples, dtype=float)
    for name, elements in groups.items():
        values[name] = np.column_stack([elements[i] for i in sorted(elements)])
    return values


def traces_of(folder: str | Path) -> Traces:
    """Return the numeric signals of a run; raises RecordingError if there is no recording."""
    table, signals = open_recording(folder)
    recorded = signals.values_by_name
    if table is not None and isinstance(recorded, LazyArrays):
        time = column(table, 0)
        return Traces(time, recorded.numbers(), signals.units, signals.element_units)
    numbers = {
        name: np.asarray(value, dtype=float)
        for name, value in recorded.items()
        if value.dtype.kind in "fiub"
    }
    return Traces(signals.time, numbers, signals.units, signals.element_units)


def provenance_of(folder: str | Path) -> dict[str, Any]:
    """Return the content of run.json; only the system's name if the run was killed before."""
    path = Path(folder) / "run.json"
    if not path.is_file():
        return {"system": Path(folder).resolve().name}
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputInvalid(path, f"cannot be read ({error})", "a run's JSON") from None
    if not isinstance(found, dict):
        raise InputInvalid(path, f"holds a {type(found).__name__}", "a run's JSON object")
    return found
