"""Linear interpolation over a Delaunay triangulation, and its errors by leave-one-out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.terrain.grid import Grid
from uuvsim_cosim.scene.terrain.points import KnownPoints
from uuvsim_cosim.scene.terrain.scan_lines import scan

__all__ = ["HoldOut", "Triangulation"]

Floats = NDArray[np.float64]

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
