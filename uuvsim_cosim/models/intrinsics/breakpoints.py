"""Linear tables with breakpoints of their own: evaluated by buckets, without a search.

The grid x is cut into equal buckets, few enough that a row bends at most once in each. A row's
value at x is the line through the last knot of that row that lies in the bucket of x, or before:
    v + (x - knot) (x < knot ? slope below : slope above).
That is the table: a knot gives its value exactly, and knots that a row merely passes are left out,
so that neither a search nor a division remains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from uuvsim_cosim.models.intrinsics.table import Table

__all__ = ["Buckets", "buckets"]

_MOST_BUCKETS = 512
_COLLINEAR = 1e-13  # of a row's largest value: what is nearer to the line is on it


@dataclass(frozen=True)
class Buckets:
    """Buckets of a table, in the precision of its numbers; the last bucket is the last knot's."""

    first: float
    last: float
    scale: float  # buckets a unit
    count: int  # without the last
    low: float  # the two rows are at y = low, high
    high: float
    rows: tuple[np.ndarray, ...]  # each [knot][x, value, slope below, slope above]
    at: tuple[np.ndarray, ...]  # each [bucket], the knot of the row


@lru_cache
def buckets(table: Table, dtype: str = "float64") -> Buckets | None:
    """Return the buckets of a table; None if it has three rows or more, or knots too close."""
    number = np.dtype(dtype).type
    x = np.array(table.x)
    values = np.array(table.values).reshape(-1, len(x))
    if len(values) > 2:
        return None
    rows = tuple(np.array([*_row(x, v)]).astype(number) for v in values)
    first, last = number(x[0]), number(x[-1])
    for count in range(1, _MOST_BUCKETS + 1):
        scale = number(count) / (last - first)
        while (last - first) * scale < count:
            scale = np.nextafter(scale, number(np.inf))
        buckets = [((row[:, 0] - first) * scale).astype(int) for row in rows]
        # A bucket may hold the first knot and one more: that one's line comes from the first.
        if all(np.all(np.diff(b[1:]) > 0) for b in buckets):
            each = np.arange(count + 1)
            at = tuple(np.searchsorted(b, each, side="right") - 1 for b in buckets)
            low, high = (table.y[0], table.y[-1]) if table.y else (0.0, 1.0)
            return Buckets(first, last, scale, count, number(low), number(high), rows, at)
    return None


def _row(x: np.ndarray, v: np.ndarray) -> Iterator[tuple[float, float, float, float]]:
    """Yield the knots at which a row bends, and the ends: x, value, slope below, slope above."""
    knots = [0]
    for j in range(1, len(x) - 1):
        i = knots[-1]
        line = v[i] + (x[j] - x[i]) * ((v[j + 1] - v[i]) / (x[j + 1] - x[i]))
        if abs(v[j] - line) > _COLLINEAR * np.max(np.abs(v)):
            knots.append(j)
    knots.append(len(x) - 1)
    slopes = np.diff(v[knots]) / np.diff(x[knots])
    around = np.concatenate([[0.0], slopes, [0.0]])
    for k, j in enumerate(knots):
        yield x[j], v[j], around[k], around[k + 1]
