"""Place of a system on Earth, if one of its components states it.

A gridded current states latitude and longitude of the local frame's origin; a chart's terrain
states the origin in a projected CRS, which needs pyproj (extra ``scene``).
"""

from __future__ import annotations

from collections.abc import Callable
from urllib.parse import parse_qsl

import numpy as np

from uuvsim_cosim.bridge.mavlink.vehicle import global_of
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.worlds.ground import scene_named
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Georeference", "around", "georeference_of"]

Georeference = Callable[[Array], Array]
"""A function that returns latitudes and longitudes (n, 2) [deg] of places N, E (n, 2) [m]."""


def georeference_of(plan: Plan) -> Georeference | None:
    """Return the georeference of a system; None if nothing states one that can be used."""
    for component in plan.components:
        given = dict(parse_qsl(component.source.partition("?")[2]))
        try:
            return around(float(given["latitude"]), float(given["longitude"]))
        except (KeyError, ValueError):
            pass
        for name in filter(None, (given.get("scene"), given.get("terrain"))):
            try:
                found = _of_chart(name)
            except (UuvsimError, OSError):
                continue
            if found is not None:
                return found
    return None


def around(latitude: float, longitude: float) -> Georeference:
    """Return the georeference of an origin [deg]; raises ValueError for a place that is none."""
    if not (abs(latitude) < 90.0 and abs(longitude) <= 360.0):
        raise ValueError(f"{latitude}, {longitude}")
    origin = (latitude, longitude)
    return lambda places: np.array([global_of(n, e, origin) for n, e in places.tolist()])


def _of_chart(name: str) -> Georeference | None:
    scene = scene_named(name)
    terrain = None if scene is None else scene.terrain
    if terrain is None or not terrain.crs:
        return None
    try:
        import pyproj

        metres = pyproj.Transformer.from_crs(terrain.crs, "EPSG:4326", always_xy=True)
    except (ImportError, ValueError, RuntimeError):  # not installed, or an unknown CRS
        return None
    northing, easting = terrain.northing, terrain.easting

    def place(places: Array) -> Array:
        longitude, latitude = metres.transform(easting + places[:, 1], northing + places[:, 0])
        return np.column_stack([latitude, longitude])

    return place
