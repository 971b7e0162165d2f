"""Scene3D of a system from its plan alone: interfaces, wires and parameters, no list of names.

A hull is a component with a pose ``eta`` (6) that ``tau`` (6) moves. Its thrusters stand where the
component that makes its ``tau`` of ``thrust`` (n) has them in its parameters ``r`` and ``e``. A
sensor with ``range`` (n) has rays, if its parameters say where they point. A component with
``position`` and ``velocity`` is a marker; one with ``origin``, ``size`` and ``tau`` is a pool.
"""

from __future__ import annotations

from collections.abc import Mapping
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration.parameter_files import is_vehicle, vehicle_size
from uuvsim_cosim.models.sensors.sonar_axes import sonar_axes
from uuvsim_cosim.models.worlds.ground import scene_named
from uuvsim_cosim.models.worlds.obstacles import Cylinder
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.running.mission import path_of
from uuvsim_cosim.view.scene3d.rays import rays_of
from uuvsim_cosim.view.scene3d.scene import Arrow, Body, Line, Marker, Mesh, Scene3D, Solid
from uuvsim_cosim.view.scene3d.shapes import (
    MOST_DRAWN,
    basin,
    box,
    hull_of,
    obstacle_mesh,
    placed_surface,
    shape_of,
)

__all__ = ["ANYTHING", "pool_solids", "scene3d_of_plan", "scene_solids", "value_of"]

Array = NDArray[np.float64]
UNKNOWN = 0.5  # m, the length of a hull of unknown size
ANYTHING = box(np.array([-0.25, -0.175, -0.125]), np.array([0.25, 0.175, 0.125]))


def scene3d_of_plan(plan: Plan, name: str = "") -> Scene3D:
    """Return the scene of a system; its notes name the parts that cannot be drawn."""
    notes: list[str] = []
    hulls = [i for i, c in enumerate(plan.components) if _is_hull(c)]
    bodies = tuple(_body(plan, i, len(hulls) == 1, notes) for i in hulls)
    markers = tuple(
        Marker(c.path, f"{c.path}.position", 0.25 * min((b.size for b in bodies), default=4 * 0.1))
        for c in plan.components
        if _output(c, "position", 3) and _output(c, "velocity", 3) and not _is_hull(c)
    )
    solids: dict[str, Solid] = {}
    for c in plan.components:
        if {"origin", "size", "obstacles"} & set(c.description.variables):
            solids |= {s.name: s for s in pool_solids(c)}
    scene: Scene | None = None  # named by a component's source: ``model:multibeam?scene=ID``
    for id in dict.fromkeys(
        id
        for c in plan.components
        for key, id in parse_qsl(c.source.partition("?")[2])
        if key in ("scene", "terrain") and id
    ):
        try:
            scene = scene_named(id)
            break
        except (UuvsimError, OSError) as error:
            notes.append(f"scene {id}: not drawn ({error})")
    if scene is not None:
        solids |= {s.name: s for s in scene_solids(scene)}
        notes += [
            f"mesh {m.name or m.file.name}: {len(m.corners):,} triangles, drawn coarser"
            for m in scene.meshes
            if len(m.corners) > MOST_DRAWN
        ]
    path = path_of(plan)
    lines = () if path is None else (Line("waypoints", np.asarray(path, float)),)
    terrain = None if scene is None else scene.terrain
    bottom = None
    if terrain is None and not solids:  # a sensor may state the depth of a flat bottom
        depths = (value_of(c, "bottom_depth") for c in plan.components)
        known = (float(d) for d in depths if d is not None and d.shape == () and np.isfinite(d))
        bottom = next(known, None)
    still = tuple(solids.values())
    sonars = {c.path: axes for c in plan.components if (axes := sonar_axes(c.source)) is not None}
    return Scene3D(
        name, bodies, markers, lines, still, terrain, bottom, tuple(notes), sonars, scene
    )  # fmt: skip


def value_of(component: PlannedComponent, name: str) -> Array | None:
    """Return a parameter's value as the plan sets it, in its shape; None if there is none."""
    variable = component.description.variables.get(name)
    if variable is None:
        return None
    value = component.start.get(name, variable.start)
    if value is None:
        return None
    try:
        return np.asarray(value, float).reshape(variable.shape)
    except (TypeError, ValueError):
        return None


def _output(component: PlannedComponent, name: str, size: int) -> bool:
    variable = component.description.variables.get(name)
    return variable is not None and variable.causality == "output" and variable.shape == (size,)


def _is_hull(component: PlannedComponent) -> bool:
    tau = component.description.variables.get("tau")
    moved = tau is not None and tau.causality == "input" and tau.shape == (6,)
    return _output(component, "eta", 6) and moved


def _body(plan: Plan, index: int, alone: bool, notes: list[str]) -> Body:
    hull = plan.components[index]
    prefix = hull.path.rpartition(".")[0]
    arrows = _arrows(plan, index)
    estimate = next(
        (
            f"{c.path}.eta"
            for c in plan.components
            if c.path != hull.path and c.path.rpartition(".")[0] == prefix
            and _output(c, "eta", 6) and "sigma" in (v.name for v in c.description.of("output"))
        ),
        "",
    )  # fmt: skip
    return Body(
        name=hull.path if alone or not prefix else prefix,
        hull=_hull_mesh(hull, arrows, notes),
        eta=f"{hull.path}.eta",
        q=f"{hull.path}.q" if _output(hull, "q", 4) else "",
        arrows=arrows,
        rays=tuple(rays_of(plan, index, value_of, notes)),
        estimate=estimate,
    )


def _arrows(plan: Plan, hull: int) -> tuple[Arrow, ...]:
    """Return the thrusts of a hull: tau is followed back to its allocation and thrusters."""
    found: list[Arrow] = []
    makers = {
        t.source for t in plan.transfers if t.target == hull and t.target_variable.name == "tau"
    }
    # There may be sums in between: a component that feeds one of these with a `tau` counts too.
    makers |= {
        t.source for t in plan.transfers if t.target in makers and t.source_variable.name == "tau"
    }
    for maker in sorted(makers):
        r, e = (value_of(plan.components[maker], name) for name in ("r", "e"))
        if r is None or e is None or r.ndim != 2 or r.shape != e.shape or r.shape[1] != 3:
            continue
        for t in plan.transfers:
            if t.target != maker or t.target_variable.name != "thrust":
                continue
            source, variable = plan.components[t.source].path, t.source_variable
            for i, j in zip(t.source_elements, t.target_elements, strict=True):
                signal = f"{source}.{variable.element_name(i)}"
                place, way = r[j].tolist(), e[j].tolist()
                found.append(Arrow(source, signal, tuple(place), tuple(way)))
    return tuple(found)


def _hull_mesh(hull: PlannedComponent, arrows: tuple[Arrow, ...], notes: list[str]) -> Mesh:
    """Return a hull by its shape or size, else a box around its thrusters, else one of 0.5 m."""
    name, _, query = hull.source.removeprefix("model:").partition("?")
    given = dict(parse_qsl(query)).get("id", "") if name == "vehicle" else name
    id = given.partition("@")[0]
    vehicle = id if hull.source.startswith("model:") and id and is_vehicle(id) else None
    if vehicle is not None:
        shape = shape_of(vehicle)
        if shape is not None:
            return shape
        size = vehicle_size(vehicle)
        if size is not None:
            return hull_of(size)
        notes.append(f"{hull.path}: {vehicle} states no size; drawn as a box")
    else:
        notes.append(f"{hull.path}: the size of {hull.source} is unknown; drawn as a box")
    if len(arrows) > 2:
        at = np.array([a.r for a in arrows])
        spread = np.maximum(np.ptp(at, axis=0), 0.3 * float(np.ptp(at, axis=0).max()))
        middle = 0.5 * (at.max(axis=0) + at.min(axis=0))
        return box(middle - 0.5 * spread, middle + 0.5 * spread)
    return ANYTHING


def pool_solids(
    component: PlannedComponent, values: Mapping[str, Array] | None = None
) -> list[Solid]:
    """Return a pool's basin and its cylinders; `values` may replace its parameters."""
    given = dict(values or {})
    size, middle, table = (
        given.get(name, value_of(component, name)) for name in ("size", "origin", "obstacles")
    )
    if size is None or np.shape(size) != (3,):
        return []
    middle = np.zeros(3) if middle is None or np.shape(middle) != (3,) else middle
    found = []
    bottom = float(middle[2] + size[2])
    found.append(Solid(f"basin at {middle[0]:g}, {middle[1]:g}", basin(middle, size), "basin"))
    for north, east, radius, height in [] if table is None else np.reshape(table, (-1, 4)).tolist():
        if radius > 0:
            half = 0.5 * min(height, float(size[2]))
            mesh = obstacle_mesh(Cylinder((north, east, bottom - half), radius, half))
            found.append(Solid(f"cylinder at {north:.3g}, {east:.3g}", mesh, "obstacle"))
    return found


def scene_solids(scene: Scene) -> list[Solid]:
    """Return a scene's obstacles, then its meshes."""
    obstacles = [
        Solid(f"{o.name or type(o).__name__.lower()} {i}", obstacle_mesh(o), "obstacle")
        for i, o in enumerate(scene.obstacles, 1)
    ]
    meshes = [
        Solid(f"{m.name or m.file.stem} {i}", placed_surface(m), "obstacle")
        for i, m in enumerate(scene.meshes, len(obstacles) + 1)
    ]
    return obstacles + meshes
