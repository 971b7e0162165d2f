"""Obstacles of a chart as boxes, spheres, capsules and cylinders.

A chart gives a place, sometimes an outline and the least depth over it (VALSOU), hardly ever a
size: the sizes in `_SIZES` are assumptions, and every obstacle's name ends in its S-57 class.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import atan2, hypot, isfinite
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.chart.read import Chart, Features

if TYPE_CHECKING:
    from shapely import Geometry

__all__ = ["obstacles_of"]

Place = tuple[float, float]
Body = Callable[[float], tuple[float, float]]  # depth of the seabed -> of the top and the bottom

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

    def at(self, place: Place) -> float:
        """Depth (m) of the nearest node; NaN on land and outside."""
        t = self.terrain
        i, j = (round((place[k] - t.origin[k]) / t.spacing) for k in (0, 1))
        inside = 0 <= i < t.z.shape[0] and 0 <= j < t.z.shape[1]
        return float(self.wet[i, j]) if inside else float("nan")

    def near(self, place: Place) -> float:
        """Depth (m) of the deepest of the nine nodes around: things stand beside the shore."""
        t = self.terrain
        i, j = (round((place[k] - t.origin[k]) / t.spacing) for k in (0, 1))
        if not (0 <= i < t.z.shape[0] and 0 <= j < t.z.shape[1]):
            return float("nan")
        around = self.wet[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
        return float(np.nanmax(around)) if np.isfinite(around).any() else float("nan")


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
                found += _made(features, index, part, ground)
    notes = [f"{foul} foul areas and grounds are no bodies: left out"] if foul else []
    return tuple(found), notes


def _made(features: Features, index: int, shape: Geometry, ground: _Ground) -> Iterator[Obstacle]:
    kind = features.kind
    name = f"{features.names[index]} {kind}".strip()
    if kind.startswith("BOY") or kind in ("LITFLT", "LITVES"):
        yield from _buoy(shape, ground, name)
    elif kind in ("PIPSOL", "CBLSUB"):
        yield from _laid(shape, ground, _SIZES[kind].radius, name)
    else:
        top_of = _top(features, index)
        size = _SIZES[kind]
        if shape.geom_type == "Point":
            yield from _upright(shape, ground, size.radius, top_of, name)
        elif shape.geom_type == "LineString":
            yield from _walls(shape, ground, size.radius, top_of, name)
        elif shape.geom_type == "Polygon":
            yield from _block(shape, ground, top_of, name)


def _top(features: Features, index: int) -> Body:
    """Return the function from the seabed's depth to depths of the body's top and bottom."""
    size = _SIZES[features.kind]
    charted, level = (float(features.values[n][index]) for n in ("VALSOU", "WATLEV"))

    def body(seabed: float) -> tuple[float, float]:
        if size.draught is not None or level == _FLOATS:
            return -_FREEBOARD, size.draught or 1.0
        if isfinite(charted):
            return charted, max(seabed, charted + 2 * _LENGTH)
        if size.top is not None:
            return size.top, seabed
        if isfinite(level) and int(level) in _ABOVE:
            return _ABOVE[int(level)], max(seabed, 2 * _LENGTH)
        return seabed - size.over_bottom, seabed

    return body


def _local(ground: _Ground, point: Sequence[float]) -> Place:
    t = ground.terrain
    return float(point[1]) - t.northing, float(point[0]) - t.easting


def _upright(
    shape: Geometry, ground: _Ground, radius: float, body: Body, name: str
) -> Iterator[Obstacle]:
    place = _local(ground, shape.coords[0])
    seabed = ground.near(place)
    if isfinite(seabed):
        top, bottom = body(seabed)
        if bottom - top > _LENGTH:
            centre = (*_rounded(*place), _centimetre((top + bottom) / 2))
            yield Cylinder(centre, radius, _centimetre((bottom - top) / 2), name)


def _buoy(shape: Geometry, ground: _Ground, name: str) -> Iterator[Obstacle]:
    if shape.geom_type != "Point":
        return
    place = _local(ground, shape.coords[0])
    seabed = ground.near(place)
    if isfinite(seabed):
        n, e = _rounded(*place)
        yield Sphere((n, e, 0.0), _BUOY, name)
        if seabed > _BUOY + _LENGTH:
            yield Capsule((n, e, _BUOY), (n, e, _centimetre(seabed)), _CHAIN, f"mooring of {name}")


def _laid(shape: Geometry, ground: _Ground, radius: float, name: str) -> Iterator[Obstacle]:
    """Yield a line on the seabed as capsules, short enough to follow it."""
    if shape.geom_type != "LineString":
        return
    step = 2 * ground.terrain.spacing
    ends = [_local(ground, p) for p in shape.segmentize(step).coords]
    depths = [ground.at(p) for p in ends]
    for a, b, za, zb in zip(ends[:-1], ends[1:], depths[:-1], depths[1:], strict=True):
        if isfinite(za) and isfinite(zb):
            start, end = (*_rounded(*a), _centimetre(za)), (*_rounded(*b), _centimetre(zb))
            yield Capsule(start, end, radius, name)


def _walls(
    shape: Geometry, ground: _Ground, half: float, body: Body, name: str
) -> Iterator[Obstacle]:
    ends = [_local(ground, p) for p in shape.simplify(_THIN).coords]
    for a, b in pairwise(ends):
        length = hypot(b[0] - a[0], b[1] - a[1])
        middle = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
        seabed = ground.near(middle)
        if not isfinite(seabed) or length < _LENGTH:
            continue
        top, bottom = body(seabed)
        if bottom - top > _LENGTH:
            yaw = atan2(b[1] - a[1], b[0] - a[0])
            yield _box(middle, top, bottom, length / 2, half, yaw, name)


def _block(shape: Geometry, ground: _Ground, body: Body, name: str) -> Iterator[Obstacle]:
    """Yield the smallest rectangle around an outline as a box."""
    around = shape.minimum_rotated_rectangle
    if around.geom_type != "Polygon":
        return
    a, b, c = (_local(ground, p) for p in list(around.exterior.coords)[:3])
    middle = ((a[0] + c[0]) / 2, (a[1] + c[1]) / 2)
    seabed = ground.near(middle)
    half = hypot(b[0] - a[0], b[1] - a[1]) / 2, hypot(c[0] - b[0], c[1] - b[1]) / 2
    if not isfinite(seabed) or min(half) < _LENGTH:
        return
    top, bottom = body(seabed)
    if bottom - top > _LENGTH:
        yield _box(middle, top, bottom, *half, atan2(b[1] - a[1], b[0] - a[0]), name)


def _box(
    middle: Place, top: float, bottom: float, long: float, wide: float, yaw: float, name: str
) -> Box:
    half = (_centimetre(long), _centimetre(wide), _centimetre((bottom - top) / 2))
    return Box((*_rounded(*middle), _centimetre((top + bottom) / 2)), half, round(yaw, 4), name)


def _rounded(n: float, e: float) -> Place:
    return _centimetre(n), _centimetre(e)


def _centimetre(length: float) -> float:
    return round(length, 2) + 0.0
