"""Signals of a recording by name, as numpy arrays, with units and provenance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.orchestrator.recording import columns
from uuvsim_cosim.orchestrator.recording.columns import LazyArrays
from uuvsim_cosim.orchestrator.recording.data_frames import to_pandas, to_xarray

__all__ = ["Signals"]


@dataclass(frozen=True)
class Signals(Mapping[str, np.ndarray]):
    """Signals by ``path.variable``: (n,) for a scalar, (n, size) for an array.

    `time` (n,) [s]; `ticks` (n,); `units` and `descriptions` by the same names, `element_units`
    with one unit for each element; `metadata` holds the provenance of the recording and the
    components' log messages (``messages``). `elements` are the elements of an array that its
    columns hold, from 1, if the recording names them: a column may have been lost. The mapping
    itself is `values_by_name`; a name that was not recorded raises InputInvalid. A signal of a
    recording is read from its file when it is asked for, and its array is read-only: copy it to
    change it.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> signals = uuv.run("bluerov2_hold", until=1.0).signals()
    >>> signals["hull.eta"].shape, signals.element_units["hull.eta"]
    ((101, 6), ('m', 'm', 'm', 'rad', 'rad', 'rad'))
    >>> signals.to_pandas().attrs["units"]["hull.eta[3]"]
    'm'
    >>> signals.to_xarray()["hull.eta"].attrs["long_name"]
    'N E D of CO [m], phi theta psi [rad]'
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

    def blocks(self, progress: Progress | None = None) -> Iterator[Signals]:
        """Yield the signals of the next rows in order, so that memory holds a block at a time.

        A block has at most 4,096 rows. A recording without rows has no block. After each block has
        been used, ``progress("writing", rows done, rows)`` is called.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> run = uuv.run("bluerov2_hold", until=1.0, out="hold")
        >>> [block["hull.eta"].shape for block in uuv.read_signals("hold").blocks()]
        [(101, 6)]
        """
        recorded, begin = self.values_by_name, 0
        if isinstance(recorded, LazyArrays):
            read: Iterator[Mapping[str, np.ndarray]] = recorded.blocks()
        else:
            size = columns.BLOCK
            starts = range(0, len(self.time), size)
            read = ({n: v[k : k + size] for n, v in recorded.items()} for k in starts)
        for values in read:
            end = begin + (len(next(iter(values.values()))) if values else columns.BLOCK)
            rows = slice(begin, end)
            if len(self.time[rows]):
                time, ticks = self.time[rows], self.ticks[rows]
                yield replace(self, time=time, ticks=ticks, values_by_name=values)
                if progress is not None:
                    progress("writing", min(end, len(self.time)), len(self.time))
            begin = end

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
