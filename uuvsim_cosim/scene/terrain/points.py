"""The points of a chart whose depth is known: soundings, contours, the shore."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.scene.chart.read import Areas, Chart
from uuvsim_cosim.scene.shared.extra import import_extra

__all__ = ["KnownPoints", "known_points"]

Floats = NDArray[np.float64]

_MOST_BORDER = 4000
_SHARED = 0.05  # m; vertices of neighbours in a chart coincide


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """Points E, N (m) with depth z (m, down).

    The first `soundings` are soundings. The last `border` are no data: they surround the chart and
    repeat the nearest depth, so that no thin triangle spans a bay along its edge.
    """

    xy: Floats  # (n, 2)
    z: Floats  # (n,)
    soundings: int
    border: int = 0


def known_points(chart: Chart, spacing: float) -> KnownPoints:
    """Return the points to triangulate; lines get a point at least every two spacings."""
    from scipy.spatial import cKDTree

    shapely = import_extra("shapely", "gridding a chart")
    step = 2 * spacing
    thinned = shapely.segmentize(shapely.simplify(chart.contours, 0.1 * spacing), step)
    contour, owner = shapely.get_coordinates(thinned, return_index=True)
    shore, shore_z = _shore(chart, step, shapely)
    sounded = _first(chart.soundings[:, :2])
    xy = np.concatenate([chart.soundings[sounded, :2], contour, shore])
    z = np.concatenate([chart.soundings[sounded, 2], chart.contour_depths[owner], shore_z])
    kept = _first(xy)
    xy, z = xy[kept], z[kept]
    # Points around all that is charted and known get the depth of the nearest known point.
    bounds = shapely.total_bounds(chart.depth_areas.shapes)
    low = np.minimum(bounds[:2], xy.min(axis=0)) - 1.0
    high = np.maximum(bounds[2:], xy.max(axis=0)) + 1.0
    apart = float((high - low).min()) / 20
    if len(sounded) > 1:
        of_sounded = cKDTree(xy[: len(sounded)])
        distances = np.asarray(of_sounded.query(xy[: len(sounded)], 2)[0])
        apart = min(apart, float(np.median(distances[:, 1])))
    around = float(2 * (high - low).sum())
    count = int(np.clip(around / max(apart, 1e-9), 16, _MOST_BORDER)) // 4 + 1
    x, y = (np.linspace(low[k], high[k], count) for k in (0, 1))
    sides = [np.stack(np.broadcast_arrays(x, e), 1) for e in (low[1], high[1])]
    sides += [np.stack(np.broadcast_arrays(e, y[1:-1]), 1) for e in (low[0], high[0])]
    border = np.concatenate(sides)
    border_z = z[cKDTree(xy).query(border)[1]]
    return KnownPoints(
        np.concatenate([xy, border]), np.concatenate([z, border_z]), len(sounded), len(border)
    )


def _first(xy: Floats) -> NDArray[np.int64]:
    """Return the rows of the first of points that coincide to 1 cm, in their order."""
    if not len(xy):
        return np.empty(0, np.int64)
    cells = np.rint((xy - xy.min(axis=0)) * 100).astype(np.int64)
    keys = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    return np.sort(np.unique(keys, return_index=True)[1])


def _shore(chart: Chart, step: float, shapely: ModuleType) -> tuple[Floats, Floats]:
    """Return points along the land's edge, with the least depth of the adjoining area.

    A shore that dries gets its drying height, a quay the depth charted along it.
    """
    from scipy.spatial import cKDTree

    areas: Areas = chart.depth_areas
    corner, owner = shapely.get_coordinates(areas.shapes, return_index=True)
    low = np.where(np.isfinite(areas.low), areas.low, 0.0)[owner]
    flat = np.isin(shapely.get_type_id(chart.land), (3, 6))
    rings = shapely.get_rings(shapely.get_parts(chart.land[flat]))
    if not len(rings):
        rings = chart.coast
    points, ring = shapely.get_coordinates(rings, return_index=True)
    if not len(points):
        return np.empty((0, 2)), np.empty(0)
    distance, nearest = cKDTree(corner).query(points, distance_upper_bound=_SHARED)
    shared = np.isfinite(distance)
    z = low[np.where(shared, nearest, 0)]
    along = (ring[1:] == ring[:-1]) & shared[1:] & shared[:-1]
    a, b, za, zb = points[:-1][along], points[1:][along], z[:-1][along], z[1:][along]
    pieces = np.maximum(1, np.ceil(np.hypot(*(b - a).T) / step)).astype(np.int64)
    which = np.repeat(np.arange(len(a)), pieces)
    part = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    t = part / pieces[which]
    xy = a[which] + t[:, None] * (b - a)[which]
    return xy, za[which] + t * (zb - za)[which]
