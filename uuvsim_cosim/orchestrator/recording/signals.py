"""Signals of a recording by name, as numpy arrays, with units and provenance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.recording.data_frames import to_pandas, to_xarray

__all__ = ["Signals"]


@dataclass(frozen=True)
class Signals(Mapping[str, np.ndarray]):
    """Signals by ``path.variable``: (n,) for a scalar, (n, size) for an array.

    `time` (n,) [s]; `ticks` (n,); `units` and `descriptions` by the same names, `element_units`
    with one unit for each element; `metadata` holds the provenance of the recording and the
    components' log messages (``messages``). `elements` are the elements of an array that its
    columns hold, from 1, if the recording names them: a column may have been lost.
    """

    time: np.ndarray
    ticks: np.ndarray
    values_by_name: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    descriptions: Mapping[str, str] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)
    element_units: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    elements: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a signal; raises InputInvalid with similar names."""
        if name not in self.values_by_name:
            known = expected_names(name, sorted(self.values_by_name))
            raise InputInvalid(f"no signal {name!r} in the recording", known)
        return self.values_by_name[name]

    def __contains__(self, name: object) -> bool:
        """Return whether a signal was recorded."""
        return name in self.values_by_name

    def __iter__(self) -> Iterator[str]:
        """Return the names."""
        return iter(self.values_by_name)

    def __len__(self) -> int:
        """Count the signals."""
        return len(self.values_by_name)

    def to_pandas(self) -> Any:
        """Return a DataFrame: the index is the time [s], a column is one element.

        Columns have the names of the elements, from 1: ``hull.eta[1]``. ``frame.attrs["units"]``
        maps each column to its unit. Raises InputInvalid without pandas (extra ``data``).
        """
        return to_pandas(self)

    def to_xarray(self) -> Any:
        """Return a Dataset with the coordinate ``time`` [s]; an array has a dimension of its own.

        The dimension of the array ``hull.eta`` is ``hull.eta_element``, with the elements' numbers,
        from 1, as coordinate. Attributes of a variable are ``units`` (one unit, or one for each
        element) and ``long_name``; those of the Dataset are the texts and numbers of the provenance
        (`metadata` has all of it).
        Raises InputInvalid without xarray (extra ``data``).
        """
        return to_xarray(self)
