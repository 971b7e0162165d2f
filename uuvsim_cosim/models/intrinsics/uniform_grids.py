"""Linear tables on a uniform grid: evaluated without a search.

Knots are added until they are one unit apart, x_k = (start + k) / per_unit, which is exact. Then
    k = (x - first) scale, rounded down,      v_k + (x - x_k) slope_k
for each row: without search, and of all tables over the same grid with the same k.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from uuvsim_cosim.models.intrinsics.table import Table

__all__ = ["UniformGrid", "uniform_grid"]

_PER_UNIT = (1, 2, 4, 5, 8, 10, 16, 20, 25, 40, 50, 100, 200)
_MOST = 256  # lines


@dataclass(frozen=True, eq=False)
class UniformGrid:
    """The lines of a table; the last one is level, for its last knot."""

    first: float
    last: float
    scale: float  # lines a unit: per_unit, or a hair more
    start: int
    per_unit: int
    low: float  # the two rows are at y = low, high
    high: float
    rows: tuple[np.ndarray, ...]  # each [k][v, slope]

    @property
    def grid(self) -> tuple[float, ...]:
        """Return what tables must share to be read together."""
        return self.first, self.last, self.scale, self.start, self.per_unit, self.low, self.high


@lru_cache
def uniform_grid(table: Table) -> UniformGrid | None:
    """Return a table's lines; None where its knots have no common unit, or it has more rows."""
    x = np.array(table.x)
    values = np.array(table.values).reshape(-1, len(x))
    if len(values) > 2:
        return None
    for per_unit in _PER_UNIT:
        at = np.round(x * per_unit)
        start, n = int(at[0]), int(at[-1] - at[0])
        if np.any(at / per_unit != x) or not len(x) - 1 <= n <= _MOST:
            continue
        knots = (start + np.arange(n + 1)) / per_unit
        scale = float(per_unit)
        while np.any(np.floor((knots - x[0]) * scale) < np.arange(n + 1)):
            scale = float(np.nextafter(scale, np.inf))
        if np.any(np.floor((knots - x[0]) * scale) != np.arange(n + 1)):
            continue
        slopes = np.diff(values) / np.diff(x)
        before = np.searchsorted(x, knots, side="right") - 1
        rows = []
        for v, slope in zip(values, slopes, strict=True):
            level = np.append(slope, 0.0)
            given = v[before] + (knots - x[before]) * level[before]
            rows.append(np.column_stack([given, level[before]]))
        low, high = (table.y[0], table.y[-1]) if table.y else (0.0, 1.0)
        return UniformGrid(table.x[0], table.x[-1], scale, start, per_unit, low, high, tuple(rows))
    return None
