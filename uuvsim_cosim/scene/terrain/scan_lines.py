"""Interpolation of triangles on a grid: each node gets the plane of the triangle around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["scan"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_AT_ONCE = 2_000_000  # nodes


def scan(
    x: Floats, y: Floats, z: Floats, triangles: NDArray[np.integer], shape: tuple[int, int]
) -> tuple[Floats, NDArray[np.float32]]:
    """Interpolate z linearly over triangles (n, 3) at the nodes (row y, column x) of a grid.

    Returns z and the magnitude of its slope (per spacing) at each node; NaN outside of triangles.
    x, y are in spacings from node (0, 0). Rows and columns are half open, and edges are computed
    from the lower vertex number to the higher, so that a node lies in exactly one triangle.
    """
    grid, steepness = np.full(shape, np.nan), np.full(shape, np.nan, np.float32)
    t = np.sort(np.asarray(triangles, np.int64), axis=1)
    ax, ay = x[t[:, 0]], y[t[:, 0]]
    bx, by = x[t[:, 1]] - ax, y[t[:, 1]] - ay
    cx, cy = x[t[:, 2]] - ax, y[t[:, 2]] - ay
    twice = bx * cy - cx * by
    first = np.clip(np.ceil(y[t].min(axis=1)), 0, shape[0]).astype(np.int64)
    last = np.clip(np.ceil(y[t].max(axis=1)), 0, shape[0]).astype(np.int64)
    beside = (x[t].max(axis=1) < 0) | (x[t].min(axis=1) > shape[1] - 1)
    kept = np.nonzero((last > first) & (twice != 0) & ~beside)[0]
    t, first, last = t[kept], first[kept], last[kept]
    zb, zc = z[t[:, 1]] - z[t[:, 0]], z[t[:, 2]] - z[t[:, 0]]
    slope_x = (zb * cy[kept] - zc * by[kept]) / twice[kept]
    slope_y = (zc * bx[kept] - zb * cx[kept]) / twice[kept]
    of, row = _expanded(first, last)
    left, right = _crossings(x, y, t, of, row)
    start = np.clip(np.ceil(left), 0, shape[1]).astype(np.int64)
    stop = np.clip(np.ceil(right), 0, shape[1]).astype(np.int64)
    ends = np.cumsum(np.maximum(stop - start, 0))
    total = int(ends[-1]) if len(ends) else 0
    cuts = np.searchsorted(ends, np.arange(_AT_ONCE, total + _AT_ONCE, _AT_ONCE))
    begin = 0
    for cut in cuts:
        end = min(int(cut) + 1, len(ends))
        line, column = _expanded(start[begin:end], stop[begin:end])
        line += begin
        triangle, r = of[line], row[line]
        a = t[triangle, 0]
        grid[r, column] = (
            z[a] + slope_x[triangle] * (column - x[a]) + slope_y[triangle] * (r - y[a])
        )
        steepness[r, column] = np.hypot(slope_x, slope_y)[triangle]
        begin = end
    return grid, steepness


def _expanded(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Return (which, number) for every number of every range [first, last)."""
    counts = np.maximum(last - first, 0)
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts) + first[
        which
    ]


def _crossings(x: Floats, y: Floats, t: Ints, of: Ints, row: Ints) -> tuple[Floats, Floats]:
    """Return where a row enters and leaves its triangle."""
    left, right = np.full(len(of), np.inf), np.full(len(of), -np.inf)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        a, b = t[of, one], t[of, other]
        low, high = np.minimum(y[a], y[b]), np.maximum(y[a], y[b])
        crosses = (low <= row) & (row < high)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = x[a] + (row - y[a]) / (y[b] - y[a]) * (x[b] - x[a])
        left = np.where(crosses, np.minimum(left, at), left)
        right = np.where(crosses, np.maximum(right, at), right)
    return left, right
