"""Facts about components that messages need beside signals: parameters, rays, place on Earth.

Numeric parameters have their own names. Names that begin with @ are found otherwise:

============== =================================================================================
@directions    (n, 3) unit vectors of the rays of an instrument, in its axes `s`
@scale         (n,) by which a reading times a direction is the point: of a depth, 1 / d_z
@grid          rows and columns of an image
@depth         1: the image has depths along the optical axis
@seen          1: the image has depths along the optical axis, or colours
@pixels        1: the image has red, green and blue of each pixel
@lens          focal length [pixels], k1 and k2 of a colour camera without a port
@fan           angle of the first beam and from beam to beam [rad], about -x of `s`
@bearings      (beams,) of a sonar's beams [rad], from its x axis towards y
@beams         (beams, 3) unit vectors of a sonar's beams, in its axes `s`
@ranges        (bins,) of the middles of a sonar's range bins [m]
@place         of the origin of `n`: 0, its latitude and longitude [deg]; or the EPSG number of a
               projected system, and northing and easting there [m]
============== =================================================================================
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias
from urllib.parse import parse_qsl

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.sensors.multibeam_and_camera import beams_of
from uuvsim_cosim.models.sensors.sonar_axes import sonar_axes
from uuvsim_cosim.models.worlds.scene import load_scene
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent

__all__ = ["Facts", "Place", "facts_of", "is_position_sensor"]

Facts: TypeAlias = Mapping[str, Mapping[str, Array]]
"""Facts by the path of a component, and their name."""
Place: TypeAlias = tuple[float, float]
"""Latitude and longitude [deg]."""


def facts_of(plan: Plan, origin: Place | None = None) -> dict[str, dict[str, Array]]:
    """Return the facts of each component; `origin` is the place of the origin of `n`.

    Without it, the place is that of the scene that a component of the system uses, if the scene
    has one.
    """
    place = {} if origin is None else {"@place": np.array([0.0, *origin])}
    if origin is None and any(_is_receiver(c) for c in plan.components):
        place = _scenes_place(plan.components)
    return {
        c.path: _parameters(c) | _rays(c) | (place if _is_receiver(c) else {})
        for c in plan.components
    }


def is_position_sensor(outputs: Iterable[str]) -> bool:
    """Return whether a component with these outputs is a GPS receiver."""
    return {"position", "velocity", "sigma", "valid"} <= set(outputs)


def _parameters(c: PlannedComponent) -> dict[str, Array]:
    return {
        v.name: np.asarray(c.start.get(v.name, v.start), float)
        for v in c.description.variables.values()
        if v.causality == "parameter" and v.type not in ("String", "Binary")
    }


def _options(c: PlannedComponent) -> tuple[str, dict[str, str]]:
    """Return the name and the options of a declaration; no name for other sources."""
    if not c.source.startswith("model:"):
        return "", {}
    name, _, query = c.source.removeprefix("model:").partition("?")
    name, _, preset = name.partition("@")
    return name, ({"id": preset} if preset else {}) | dict(parse_qsl(query))


def _rays(c: PlannedComponent) -> dict[str, Array]:
    """Return the rays of a multibeam, a camera, or a DVL; none for other components."""
    parameters = {v.name for v in c.description.of("parameter")}
    if {"tilt", "azimuth", "r_s", "Theta_s"} <= parameters:
        values = _parameters(c)
        t, a = values["tilt"], values["azimuth"]
        beams = [np.sin(t) * np.cos(a), np.sin(t) * np.sin(a), np.cos(t) * np.ones(a.shape)]
        return {"@directions": np.stack(beams, axis=-1), "@scale": np.ones(a.shape)}
    name, options = _options(c)
    if name == "color_camera":
        return _colours(_parameters(c), options)
    if (axes := sonar_axes(c.source)) is not None:
        along = axes.beams[:1] if axes.scans else axes.beams
        found: dict[str, Array] = {
            "@bearings": np.zeros(1) if axes.scans else axes.bearings, "@ranges": axes.ranges,
            "@beams": along, "@scale": np.ones(len(along)),
        }  # fmt: skip
        is_fan = not axes.scans and len(along) > 2
        return found | ({"@directions": along} if is_fan else {})  # an echo's place is known
    try:
        d = np.asarray(beams_of(name, options.pop("id", ""), **options).directions)
    except (UuvsimError, TypeError, ValueError):
        return {}
    if name == "multibeam":
        angle = np.arctan2(d[:, 1], d[:, 2])
        fan = np.array([angle[0], (angle[-1] - angle[0]) / (len(angle) - 1)])
        return {"@directions": d, "@scale": np.ones(len(d)), "@fan": fan}
    columns = int(options.get("columns", 16))
    grid = {"@directions": d, "@grid": np.array([len(d) // columns, columns])}
    if options.get("reading", "depth") == "depth":
        depth = {"@depth": np.ones(1), "@seen": np.ones(1), "@lens": np.ones(1)}
        return {**grid, **depth, "@scale": 1 / d[:, 2]}
    return {**grid, "@scale": np.ones(len(d))}


def _colours(values: Mapping[str, Array], options: Mapping[str, str]) -> dict[str, Array]:
    """Return the facts of a colour camera; CameraInfo cannot describe a flat port."""
    size = np.array([int(options.get("rows", 24)), int(options.get("columns", 32))])
    found = {"@grid": size, "@pixels": np.ones(1), "@seen": np.ones(1)}
    if "port_distance" not in values:
        found["@lens"] = np.append(values["focal_length"], values["distortion"])
    return found


def _is_receiver(c: PlannedComponent) -> bool:
    return is_position_sensor(v.name for v in c.description.of("output"))


def _scenes_place(components: Iterable[PlannedComponent]) -> dict[str, Array]:
    """Return the place of the first scene that has one."""
    for name in dict.fromkeys(_options(c)[1].get("scene", "") for c in components):
        try:
            terrain = load_scene(name).terrain if name else None
        except (UuvsimError, OSError):
            continue
        number = "" if terrain is None else terrain.crs.removeprefix("EPSG:")
        if terrain is not None and number.isdecimal():
            return {"@place": np.array([int(number), terrain.northing, terrain.easting])}
    return {}
