"""Obstacles of a chart as boxes, spheres, capsules and cylinders.

A chart gives a place, sometimes an outline and the least depth over it (VALSOU), hardly ever a
size: the sizes in `_SIZES` are assumptions, and every obstacle's name ends in its S-57 class.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, hypot, isfinite
from typing import TYPE_CHECKING, overload

import numpy as np

from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.chart.read import Chart, Features

if TYPE_CHECKING:
    from shapely import Geometry

__all__ = ["obstacles_of"]

Place = tuple[float, float]

_LENGTH = 0.05  # m; thinner or lower features are left out
_FOUL = (6, 7, 8, 9)  # CATOBS: foul area, foul ground, ice boom, ground tackle: no solid body
_FLOATS = 7  # WATLEV
_ABOVE = {1: -2.0, 2: -2.0, 4: 0.0, 5: 0.0}  # WATLEV: depth of the top where VALSOU is not charted


@dataclass(frozen=True)
class _Size:
    """Assumed sizes in m of one object class."""

    radius: float  # of the body, or half the width of a line of it
    over_bottom: float = 1.0  # height of features that are always under water, at an unknown depth
    top: float | None = None  # depth of the top of features that stand out of the water
    draught: float | None = None  # of features that float


_SIZES = {
    "OBSTRN": _Size(1.0), "UWTROC": _Size(2.0), "WRECKS": _Size(5.0, over_bottom=3.0),
    "PILPNT": _Size(0.25, top=-3.0), "MORFAC": _Size(0.6, top=-3.0), "PYLONS": _Size(3.0, top=-5.0),
    "OFSPLF": _Size(15.0, top=-10.0),
    "BCNLAT": _Size(0.25, top=-3.0), "BCNCAR": _Size(0.25, top=-3.0),
    "BCNISD": _Size(0.25, top=-3.0), "BCNSAW": _Size(0.25, top=-3.0),
    "BCNSPP": _Size(0.25, top=-3.0),
    "PONTON": _Size(1.5, draught=0.5), "HULKES": _Size(5.0, draught=3.0),
    "FLODOC": _Size(10.0, draught=5.0),
    "PIPSOL": _Size(0.3), "CBLSUB": _Size(0.05),
}  # fmt: skip
_BUOY = 1.0  # m, radius of a buoy's body
_CHAIN = 0.05  # m, radius of its mooring
_FREEBOARD = 0.5  # m
_THIN = 0.5  # m; an outline is simplified by this much


class _Ground:
    """Depth of the seabed at places of the local frame."""

    def __init__(self, terrain: Terrain) -> None:
        self.terrain = terrain
        self.wet = terrain.z if terrain.sigma is None else np.where(
            np.isnan(terrain.sigma), np.nan, terrain.z
        )  # fmt: skip

    def depth(self, place: Place, reach: int = 0) -> float:
        """Return the depth (m) of the deepest node at most `reach` nodes from the nearest one.

        NaN on land and outside. With a reach of 1, a place beside the shore has the depth of the
        water there.
        """
        t = self.terrain
        i, j = (round((place[k] - t.origin[k]) / t.spacing) for k in (0, 1))
        if not (0 <= i < t.z.shape[0] and 0 <= j < t.z.shape[1]):
            return float("nan")
        around = self.wet[max(i - reach, 0) : i + reach + 1, max(j - reach, 0) : j + reach + 1]
        return float(np.nanmax(around)) if np.isfinite(around).any() else float("nan")

    def local(self, point: Sequence[float]) -> Place:
        """Return N, E in the local frame of a point E, N of the projection."""
        return float(point[1]) - self.terrain.northing, float(point[0]) - self.terrain.easting


def obstacles_of(chart: Chart, terrain: Terrain) -> tuple[tuple[Obstacle, ...], list[str]]:
    """Return the obstacles in a terrain's water, and notes on features that were left out."""
    ground = _Ground(terrain)
    found: list[Obstacle] = []
    foul = 0
    for features in chart.features:
        for index, shape in enumerate(features.shapes):
            if features.kind == "OBSTRN" and features.values["CATOBS"][index] in _FOUL:
                foul += 1
                continue
            for part in getattr(shape, "geoms", [shape]):
                found += _bodies(features, index, part, ground)
    notes = [f"{foul} foul areas and grounds are no bodies: left out"] if foul else []
    return tuple(found), notes


def _bodies(features: Features, index: int, shape: Geometry, ground: _Ground) -> Iterator[Obstacle]:
    object_class = features.kind
    name = f"{features.names[index]} {object_class}".strip()
    if object_class.startswith("BOY") or object_class in ("LITFLT", "LITVES"):
        if shape.geom_type != "Point":
            return
        place = ground.local(shape.coords[0])
        seabed = ground.depth(place, 1)
        if isfinite(seabed):
            n, e = _centimetres(*place)
            yield Sphere((n, e, 0.0), _BUOY, name)
            if seabed > _BUOY + _LENGTH:
                anchor = (n, e, *_centimetres(seabed))
                yield Capsule((n, e, _BUOY), anchor, _CHAIN, f"mooring of {name}")
        return
    size = _SIZES[object_class]
    if object_class in ("PIPSOL", "CBLSUB"):
        if shape.geom_type != "LineString":
            return
        # A line on the seabed as capsules, short enough to follow it.
        line = shape.segmentize(2 * ground.terrain.spacing).coords
        places = [ground.local(p) for p in line]
        ends = [_centimetres(*place, ground.depth(place)) for place in places]
        for start, end in pairwise(ends):
            if isfinite(start[2]) and isfinite(end[2]):
                yield Capsule(start, end, size.radius, name)
        return
    for middle, half, yaw in _footprints(shape, ground, size.radius):
        seabed = ground.depth(middle, 1)
        if not isfinite(seabed):
            continue
        top, bottom = _top_and_bottom(features, index, seabed)
        if bottom - top <= _LENGTH:
            continue
        centre = _centimetres(*middle, (top + bottom) / 2)
        if half is None:
            yield Cylinder(centre, size.radius, *_centimetres((bottom - top) / 2), name)
        else:
            yield Box(centre, _centimetres(*half, (bottom - top) / 2), round(yaw, 4), name)


def _footprints(
    shape: Geometry, ground: _Ground, radius: float
) -> Iterator[tuple[Place, Place | None, float]]:
    """Yield middle, half length and width (None: round), and yaw of the bodies of a shape."""
    if shape.geom_type == "Point":
        yield ground.local(shape.coords[0]), None, 0.0
    elif shape.geom_type == "LineString":
        for a, b in pairwise(ground.local(p) for p in shape.simplify(_THIN).coords):
            length = hypot(b[0] - a[0], b[1] - a[1])
            if length >= _LENGTH:
                middle = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
                yield middle, (length / 2, radius), atan2(b[1] - a[1], b[0] - a[0])
    elif shape.geom_type == "Polygon":
        around = shape.minimum_rotated_rectangle
        if around.geom_type != "Polygon":
            return
        a, b, c = (ground.local(p) for p in list(around.exterior.coords)[:3])
        half = hypot(b[0] - a[0], b[1] - a[1]) / 2, hypot(c[0] - b[0], c[1] - b[1]) / 2
        if min(half) >= _LENGTH:
            middle = ((a[0] + c[0]) / 2, (a[1] + c[1]) / 2)
            yield middle, half, atan2(b[1] - a[1], b[0] - a[0])


def _top_and_bottom(features: Features, index: int, seabed: float) -> tuple[float, float]:
    """Return the depths of a body's top and bottom."""
    size = _SIZES[features.kind]
    charted, level = (float(features.values[n][index]) for n in ("VALSOU", "WATLEV"))
    if size.draught is not None or level == _FLOATS:
        return -_FREEBOARD, size.draught or 1.0
    if isfinite(charted):
        return charted, max(seabed, charted + 2 * _LENGTH)
    if size.top is not None:
        return size.top, seabed
    if isfinite(level) and int(level) in _ABOVE:
        return _ABOVE[int(level)], max(seabed, 2 * _LENGTH)
    return seabed - size.over_bottom, seabed


@overload
def _centimetres(x: float, /) -> tuple[float]: ...
@overload
def _centimetres(x: float, y: float, /) -> tuple[float, float]: ...
@overload
def _centimetres(x: float, y: float, z: float, /) -> tuple[float, float, float]: ...
def _centimetres(*lengths: float) -> tuple[float, ...]:
    """Round lengths [m] to whole centimetres, without -0.0."""
    return tuple(round(length, 2) + 0.0 for length in lengths)
