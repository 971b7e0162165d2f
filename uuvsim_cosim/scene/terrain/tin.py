"""Linear interpolation over a Delaunay triangulation, and its errors by leave-one-out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.terrain.grid import Grid
from uuvsim_cosim.scene.terrain.points import KnownPoints

__all__ = ["HoldOut", "Triangulation", "scan"]

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
    # Positions at which a row enters and leaves its triangle.
    left, right = np.full(len(of), np.inf), np.full(len(of), -np.inf)
    for one, other in ((0, 1), (0, 2), (1, 2)):
        a, b = t[of, one], t[of, other]
        low, high = np.minimum(y[a], y[b]), np.maximum(y[a], y[b])
        crosses = (low <= row) & (row < high)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = x[a] + (row - y[a]) / (y[b] - y[a]) * (x[b] - x[a])
        left = np.where(crosses, np.minimum(left, at), left)
        right = np.where(crosses, np.maximum(right, at), right)
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


_MOST_LEFT_OUT = 2000  # soundings; evenly drawn from more
_MOST_NEIGHBOURS = 60  # the farthest of more cannot span the triangle sought, or hardly ever
_NEAR = 0.1  # quantile of the distances below which the error falls to 0 at the data
_LEAST_IN_BIN = 25  # errors from which a root mean square is taken


class Triangulation:
    """Delaunay triangles over known points."""

    def __init__(self, points: KnownPoints) -> None:
        from scipy.spatial import Delaunay

        if len(points.xy) < 3:
            raise InputInvalid(f"{len(points.xy)} points of known depth; at least 3 are needed")
        self.points = points
        self.xy = points.xy - points.xy.mean(axis=0)
        try:
            self.triangles = Delaunay(self.xy)
        except Exception:
            raise InputInvalid("all points of known depth lie on one line") from None

    def over(self, grid: Grid, z: Floats | None = None) -> tuple[Floats, NDArray[np.float32]]:
        """Return depth (m) and slope at the nodes of a grid; NaN outside the known points' hull.

        `z` is interpolated in place of the depths, if given; (points,).
        """
        x, y = ((self.points.xy - (grid.west, grid.south)) / grid.spacing).T
        values = self.points.z if z is None else z
        depth, slope = scan(x, y, values, self.triangles.simplices, grid.shape)
        return depth, slope / np.float32(grid.spacing)

    def left_out(self) -> tuple[NDArray[np.int64], Floats, Floats, Floats]:
        """Leave out each sounding in turn: (row, depth by the others, its slope, distance).

        Removing a vertex changes only the triangles around it; over the hole, the Delaunay
        triangulation of its neighbours is that of all other points. So this is exact, and cheap.
        NaN for soundings at the edge of the known points.
        """
        n = self.points.soundings
        rows = np.unique(np.linspace(0, n - 1, min(n, _MOST_LEFT_OUT)).astype(np.int64))[: n or 0]
        known = len(self.points.xy) - self.points.border
        starts, neighbours = self.triangles.vertex_neighbor_vertices
        value = np.full(len(rows), np.nan)
        slope, distance = np.full(len(rows), np.nan), np.full(len(rows), np.nan)
        for k, row in enumerate(rows):
            ring = neighbours[starts[row] : starts[row + 1]]
            if len(ring) < 3 or ring.max() >= known:  # a border point may repeat this sounding
                continue
            at = self.xy[ring] - self.xy[row]
            far = np.hypot(*at.T)
            distance[k] = far.min()
            if len(ring) > _MOST_NEIGHBOURS:
                at, ring = at[near := np.argsort(far)[:_MOST_NEIGHBOURS]], ring[near]
            value[k], slope[k] = _at_origin(at, self.points.z[ring])
        return rows, value, slope, distance


def _at_origin(xy: Floats, z: Floats) -> tuple[float, float]:
    """Return value and slope at the origin of a few points' Delaunay triangle; NaN outside them.

    Lifted onto the paraboloid |p|², the Delaunay triangles are the lower hull: of all triangles
    that hold the origin it is the one whose lifted plane is lowest there.
    """
    i, j, k = _triples(len(xy))
    x, y = xy.T
    wi = x[j] * y[k] - x[k] * y[j]
    wj = x[k] * y[i] - x[i] * y[k]
    wk = x[i] * y[j] - x[j] * y[i]
    area = wi + wj + wk
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.stack([wi, wj, wk]) / area
    holds = (weights >= -1e-12).all(axis=0) & (np.abs(area) > 1e-9)
    if not holds.any():
        return float("nan"), float("nan")
    square = x * x + y * y
    corners = np.stack([i, j, k])
    lifted = np.where(holds, (np.where(holds, weights, 0.0) * square[corners]).sum(axis=0), np.inf)
    best = int(np.argmin(lifted))
    chosen = corners[:, best]
    value = float(weights[:, best] @ z[chosen])
    (ax, ay), (bx, by) = xy[chosen[1]] - xy[chosen[0]], xy[chosen[2]] - xy[chosen[0]]
    za, zb = z[chosen[1]] - z[chosen[0]], z[chosen[2]] - z[chosen[0]]
    return value, float(np.hypot(za * by - zb * ay, zb * ax - za * bx) / abs(area[best]))


@lru_cache(maxsize=64)
def _triples(n: int) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return every i < j < k below n."""
    i, j, k = np.meshgrid(*[np.arange(n)] * 3, indexing="ij")
    rising = (i < j) & (j < k)
    return i[rising], j[rising], k[rising]


@dataclass(frozen=True, eq=False)
class HoldOut:
    """Errors of interpolation at soundings that were left out.

    They grow with the distance to data and with the slope there; their product, how far the seabed
    falls over that distance, orders them best (Tacoma: rank correlation 0.5; distance alone 0.25).
    """

    errors: Floats  # m, interpolated minus sounded
    distances: Floats  # m, to the nearest point that was not left out
    slopes: Floats  # of the triangle that was interpolated in

    @property
    def median(self) -> float:
        """Median of the errors' magnitude (m); NaN without soundings."""
        return float(np.median(np.abs(self.errors))) if len(self.errors) else float("nan")

    @property
    def mean(self) -> float:
        """Mean of the errors' magnitude (m)."""
        return float(np.mean(np.abs(self.errors))) if len(self.errors) else float("nan")

    def __str__(self) -> str:
        """Return the errors' median and mean."""
        return (
            f"median error {self.median:.2f} m, mean {self.mean:.2f} m "
            f"({len(self.errors)} one by one)"
        )

    def knots(self) -> tuple[Floats, Floats]:
        """Return falls (m; distance times slope) and the root mean square error (m), never less."""
        fall = self.distances * self.slopes
        bins = max(1, min(8, len(fall) // _LEAST_IN_BIN))
        parts = np.array_split(np.argsort(fall, kind="stable"), bins)
        at = np.array([float(np.median(fall[p])) for p in parts])
        rms = np.array([float(np.sqrt(np.mean(self.errors[p] ** 2))) for p in parts])
        return at, np.maximum.accumulate(rms)

    def sigma(self, distance: Floats, slope: Floats) -> Floats:
        """Return the standard deviation (m) at distances to data (m) and slopes; 0 at the data.

        Beyond the greatest fall that was left out it grows in proportion.
        """
        at, rms = self.knots()
        fall = distance * slope
        spread = np.interp(fall, at, rms)
        if at[-1] > 0:
            spread = np.maximum(spread, rms[-1] * fall / at[-1])
        near = float(np.quantile(self.distances, _NEAR))
        return spread * np.minimum(1.0, distance / max(near, 1e-3))

    @property
    def within_two_sigma(self) -> float:
        """Share of the errors that are at most twice the standard deviation given for them."""
        given = self.sigma(self.distances, self.slopes)
        return float(np.mean(np.abs(self.errors) <= 2 * given)) if len(given) else float("nan")
