"""Grid of mean depths: for each cell, the mean of the points in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["HeightGrid", "Window"]

Array = NDArray[np.float64]
MOST_CELLS = 40_000_000


@dataclass(frozen=True)
class Window:
    """Cells of `cell` [m]; the corner of the first is at (north, east) [m] in `n`."""

    north: float
    east: float
    cell: float
    rows: int
    columns: int

    @staticmethod
    def around(lowest: Array, highest: Array, margin: float, cell: float) -> Window:
        """Return the window, on whole cells, of places (N, E) and a margin [m]."""
        if not (np.isfinite(cell) and cell > 0):
            raise InputInvalid(f"cell {cell} m", "more than 0")
        first = np.floor((lowest - margin) / cell) * cell
        n = np.ceil((highest + margin - first) / cell).astype(int)
        if int(n[0]) * int(n[1]) > MOST_CELLS:
            raise InputInvalid(
                f"a map of {n[0]:,} x {n[1]:,} cells of {cell:g} m",
                f"at most {MOST_CELLS:,} cells: give a larger one",
            )
        return Window(float(first[0]), float(first[1]), cell, int(n[0]), int(n[1]))

    @property
    def centres(self) -> tuple[Array, Array]:
        """Return N (rows,) and E (columns,) of the cells' centres [m]."""
        north: Array = self.north + (np.arange(self.rows, dtype=np.float64) + 0.5) * self.cell
        east: Array = self.east + (np.arange(self.columns, dtype=np.float64) + 0.5) * self.cell
        return north, east


@final
@dataclass(eq=False)
class HeightGrid:
    """Sums over the cells of a window; points are added batch by batch."""

    window: Window
    total: Array = field(init=False)
    count: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        size = self.window.rows * self.window.columns
        self.total, self.count = np.zeros(size), np.zeros(size, np.int64)

    def add(self, north: Array, east: Array, depth: Array) -> None:
        """Add points (n,) each [m]; points outside of the window are ignored."""
        w = self.window
        i = np.floor((north - w.north) * (1.0 / w.cell)).astype(np.int64)
        j = np.floor((east - w.east) * (1.0 / w.cell)).astype(np.int64)
        inside = (i >= 0) & (i < w.rows) & (j >= 0) & (j < w.columns)
        if not inside.all():
            i, j, depth = i[inside], j[inside], depth[inside]
        if len(i) == 0:
            return
        # Only the rows that the batch reaches: a batch is a small part of a large map.
        low, high = int(i.min()), int(i.max()) + 1
        flat = (i - low) * w.columns + j
        size = (high - low) * w.columns
        part = slice(low * w.columns, high * w.columns)
        self.total[part] += np.bincount(flat, weights=depth, minlength=size)
        self.count[part] += np.bincount(flat, minlength=size)

    def mean(self, least: int = 1) -> Array:
        """Return the mean depth (rows, columns) [m]; NaN with less than `least` points."""
        with np.errstate(invalid="ignore", divide="ignore"):
            z = np.where(self.count >= least, self.total / self.count, np.nan)
        return z.reshape(self.window.rows, self.window.columns)
