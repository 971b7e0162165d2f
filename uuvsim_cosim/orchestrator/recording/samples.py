"""Samples of a signal over time: an array, or a column that is read block by block at each use.

A column bounds the memory of a report: a day of a mission has millions of samples of each signal.
Functions here take both and return the same kind. For an array they do what NumPy does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.orchestrator.recording.columns import LazyArrays

__all__ = [
    "Array",
    "Column",
    "Samples",
    "at_rows",
    "blocks",
    "computed",
    "element",
    "picked",
    "track_rows",
    "unwrapped",
    "within",
]

Array = NDArray[np.float64]
ROWS = 1 << 16  # of a block of an array: an intermediate result has as many


@dataclass(frozen=True, eq=False)
class Column:
    """Samples (T,) whose blocks are read or computed in order of time, each time they are used.

    Columns of one recording have the same blocks. `np.asarray(column)` returns all samples.
    """

    read: Callable[[], Iterator[Array]]
    length: int

    def __len__(self) -> int:
        """Return the number of samples."""
        return self.length

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        """Return all samples, shape (T,)."""
        whole = np.empty(self.length)
        first = 0
        for block in self.read():
            whole[first : first + len(block)] = block
            first += len(block)
        return whole if dtype is None else whole.astype(dtype)


Samples = Array | Column


def element(signals: Mapping[str, Array], name: str, k: int, length: int) -> Samples:
    """Return element `k`, from 0, of a signal of `length` rows; a column if it is in a file."""
    if isinstance(signals, LazyArrays):
        return Column(partial(signals.element_blocks, name, k), length)
    return signals[name].reshape(length, -1)[:, k]


def at_rows(signals: Mapping[str, NDArray[Any]], name: str, rows: NDArray[np.intp]) -> NDArray[Any]:
    """Return a signal at some rows, from 0, in ascending order; of a file, only these are kept."""
    if isinstance(signals, LazyArrays):
        return signals.at_rows(name, rows)
    return np.asarray(signals[name])[rows]


def blocks(samples: Samples) -> Iterator[Array]:
    """Yield the samples in blocks, in order of time."""
    if isinstance(samples, Column):
        yield from samples.read()
    else:
        for first in range(0, len(samples), ROWS):
            yield samples[first : first + ROWS]


def computed(function: Callable[..., Array], *samples: Samples) -> Samples:
    """Return a function of the samples at the same time; columns are of one recording."""
    if not any(isinstance(s, Column) for s in samples):
        return function(*samples)
    return Column(lambda: map(function, *map(blocks, samples)), len(samples[0]))


def picked(samples: Samples, rows: NDArray[np.intp]) -> Array:
    """Return the samples of some rows, from 0, in ascending order."""
    if not isinstance(samples, Column):
        return np.asarray(samples[rows], float)
    found, first = [np.empty(0)], 0
    for block in samples.read():
        low, high = np.searchsorted(rows, [first, first + len(block)])
        found.append(block[rows[low:high] - first])
        first += len(block)
    return np.concatenate(found)


def within(samples: Samples, first: int, end: int | None = None) -> Samples:
    """Return the samples with NaN before row `first`, and from row `end` on if it is given."""
    last = len(samples) if end is None else end

    def read() -> Iterator[Array]:
        row = 0
        for block in blocks(samples):
            rows = np.arange(row, row + len(block))
            yield np.where((rows >= first) & (rows < last), block, np.nan)
            row += len(block)

    column = Column(read, len(samples))
    return column if isinstance(samples, Column) else np.asarray(column)


def track_rows(north: Samples, east: Samples, most: int) -> NDArray[np.intp]:
    """Return rows, in ascending order, that show a track: all, or `most` of them.

    Half are even in time, and half in the distance that was travelled: a vehicle that works for
    ten minutes of a day and then waits is shown in its work too. The first and the last row are
    among them.
    """
    n = len(north)
    if n <= most:
        return np.arange(n)
    rows = [np.linspace(0, n - 1, most // 2).astype(np.intp)]
    length = max(sum(float(np.sum(step)) for step in _steps(north, east)), 1e-300)
    along, first, count = 0.0, 1, most - most // 2
    for step in _steps(north, east):
        part = np.floor((along + np.cumsum(step)) * (count / length))
        before = np.concatenate([[np.floor(along * (count / length))], part[:-1]])
        rows.append(first + np.flatnonzero(part > before))
        along += float(np.sum(step))
        first += len(step)
    return np.unique(np.concatenate(rows))


def _steps(north: Samples, east: Samples) -> Iterator[Array]:
    """Yield the horizontal distance of each row after the first to the row before it, by block."""
    before = np.empty((0, 2))
    for each in zip(blocks(north), blocks(east), strict=True):
        position = np.concatenate([before, np.column_stack(each)])
        change = np.diff(position, axis=0)
        yield np.nan_to_num(np.hypot(change[:, 0], change[:, 1]))
        before = position[-1:]


def unwrapped(angle: Samples) -> Samples:
    """Return angles [rad] without jumps of 2 pi, as `np.unwrap` does."""
    if not isinstance(angle, Column):
        return np.unwrap(angle)

    def read() -> Iterator[Array]:
        before = np.empty(0)
        for block in angle.read():
            whole = np.unwrap(np.concatenate([before, block]))[len(before) :]
            before = whole[-1:]
            yield whole

    return Column(read, len(angle))
