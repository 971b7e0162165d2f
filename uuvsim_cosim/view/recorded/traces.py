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
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

__all__ = ["Array", "Traces", "joined", "provenance_of", "traces_of"]

Array = NDArray[np.float64]


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
        if value is not None and value.ndim == 2:
            return value[:, 0] if value.shape[1] == 1 else None
        return value

    def by_unit(self, name: str, most: int) -> list[tuple[str, list[int]]]:
        """Return the elements (from 0) of a signal in groups of one unit and at most `most`."""
        value = self.values[name]
        size = 1 if value.ndim == 1 else value.shape[1]
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
    for name, column in columns.items():
        whole, indices = split_element_name(name)
        if indices:
            groups.setdefault(whole, {})[indices] = np.asarray(column, dtype=float)
        else:
            values[name] = np.asarray(column, dtype=float)
    for name, elements in groups.items():
        values[name] = np.column_stack([elements[i] for i in sorted(elements)])
    return values


def traces_of(folder: str | Path) -> Traces:
    """Return the numeric signals of a run; raises RecordingError if there is no recording."""
    signals = read_signals(folder)
    numbers = {
        name: np.asarray(value, dtype=float)
        for name, value in signals.items()
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
