"""Foxglove's JSON messages of a scene: entities, points and poses, in the axes that are wanted."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uuvsim_cosim.view.recorded.traces import Array
from uuvsim_cosim.view.scene3d.colours import (
    BODIES,
    ESTIMATE,
    MARKER,
    PATH,
    SOLIDS,
    depth_colours,
    rgb,
)
from uuvsim_cosim.view.scene3d.scene import Mesh, Scene3D
from uuvsim_cosim.view.scene3d.shapes import lathe, terrain_mesh

__all__ = [
    "CLOUD", "NED", "SCENE", "Axes", "ball", "cloud", "entity", "point", "schema_of", "stamp",
    "still_entities", "still_pose", "strip", "tracks", "triangles",
]  # fmt: skip

SCENE = {"deletions": "array", "entities": "array"}  # fields of foxglove.SceneUpdate
CLOUD = {"data": "string"}  # of foxglove.PointCloud
TRACK = 2000


def _same(v: Array) -> Array:
    return v


@dataclass(frozen=True)
class Axes:
    """Axes of the messages: the frame of the world, that of a body, and vectors (n, 3) in both."""

    frame: str
    frame_of: Callable[[str], str] = str
    world: Callable[[Array], Array] = _same
    body: Callable[[Array], Array] = _same


NED = Axes("ned")


def schema_of(name: str, fields: Mapping[str, str]) -> dict[str, object]:
    """Return the JSON schema of one of Foxglove's types, with the types of its fields."""
    properties: dict[str, dict[str, str]] = {
        "timestamp": {"type": "object"}, "frame_id": {"type": "string"},
        **{field: {"type": kind} for field, kind in fields.items()},
    }  # fmt: skip
    if name == "foxglove.PointCloud":
        properties["data"]["contentEncoding"] = "base64"
    return {"type": "object", "title": name, "properties": properties}


def still_entities(scene3d: Scene3D, at: int, axes: Axes) -> Iterator[dict[str, object]]:
    """Yield terrain, solids, lines, hulls and markers; the last two move with their frames."""
    if scene3d.terrain is not None:
        mesh = terrain_mesh(scene3d.terrain, 128)
        colours = [_colour(c) for c in depth_colours(mesh.vertices[:, 2]).tolist()]
        shape = triangles(_turned(mesh, axes.world), PATH) | {"colors": colours}
        yield entity("terrain", axes.frame, at, triangles=[shape])
    for solid in scene3d.solids:
        alpha = 0.3 if solid.kind == "basin" else 1.0
        mesh = _turned(solid.mesh, axes.world)
        shape = triangles(mesh, SOLIDS.get(solid.kind, PATH), alpha)
        yield entity(solid.name, axes.frame, at, triangles=[shape])
    for line in scene3d.lines:
        yield entity(line.name, axes.frame, at, lines=[strip(axes.world(line.points), PATH)])
    for i, body in enumerate(scene3d.bodies):
        hull = triangles(_turned(body.hull, axes.body), BODIES[i % len(BODIES)])
        frame = axes.frame_of(body.name)
        yield entity(f"{body.name} hull", frame, at, triangles=[hull], locked=True)
    for marker in scene3d.markers:
        shape = triangles(ball(marker.radius), MARKER)
        frame = axes.frame_of(marker.name)
        yield entity(marker.name, frame, at, triangles=[shape], locked=True)


def tracks(
    scene3d: Scene3D,
    positions: Mapping[str, Array],
    estimates: Mapping[str, Array],
    at: int,
    axes: Axes,
) -> Iterator[dict[str, object]]:
    """Yield the tracks (n, 3) in `n` of bodies, and those of their estimates."""
    for i, body in enumerate(scene3d.bodies):
        for found, what, tint in (
            (positions.get(body.name), "track", BODIES[i % len(BODIES)]),
            (estimates.get(body.name), "estimate", ESTIMATE),
        ):
            if found is not None:
                line = strip(axes.world(found), tint)
                yield entity(f"{body.name} {what}", axes.frame, at, lines=[line])


def ball(radius: float) -> Mesh:
    """Return a sphere around the origin."""
    t = np.linspace(0.0, np.pi, 9)
    return lathe(-radius * np.cos(t), radius * np.sin(t), 14)


def cloud(points: Array, at: int, frame: str) -> dict[str, object]:
    """Return a foxglove.PointCloud of points (n, 3)."""
    return {
        "timestamp": stamp(at), "frame_id": frame, "pose": still_pose(), "point_stride": 12,
        "fields": [{"name": n, "offset": 4 * i, "type": 7} for i, n in enumerate("xyz")],
        "data": base64.b64encode(points.astype("<f4").tobytes()).decode(),
    }  # fmt: skip


def stamp(at: int) -> dict[str, int]:
    """Return a time [ns] as Foxglove's JSON has it."""
    return {"sec": at // 1_000_000_000, "nsec": at % 1_000_000_000}


def point(p: Array | Sequence[float]) -> dict[str, float]:
    """Return a point or vector, rounded to 10 µm."""
    return {axis: round(float(v), 5) for axis, v in zip("xyz", p, strict=True)}


def still_pose() -> dict[str, object]:
    """Return the pose of a frame in itself."""
    return {"position": point((0, 0, 0)), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}


def entity(
    name: str, frame: str, at: int, *, locked: bool = False, **shapes: list[dict[str, object]]
) -> dict[str, object]:
    """Return a SceneEntity; a `locked` one moves with its frame."""
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": stamp(at), "frame_id": frame, "id": name, "lifetime": stamp(0),
        "frame_locked": locked, "metadata": [],
        **{kind: shapes.get(kind, []) for kind in kinds},
    }  # fmt: skip


def triangles(mesh: Mesh, colour: str, alpha: float = 1.0) -> dict[str, object]:
    """Return a TriangleListPrimitive."""
    return {
        "pose": still_pose(), "points": [point(v) for v in mesh.vertices.tolist()],
        "color": _colour(rgb(colour), alpha), "colors": [],
        "indices": mesh.faces.reshape(-1).tolist(),
    }  # fmt: skip


def strip(points: Array, colour: str) -> dict[str, object]:
    """Return a LinePrimitive through points (n, 3), without those that are not finite."""
    known = points[np.isfinite(points).all(axis=1)]
    picks = np.unique(np.linspace(0, max(len(known) - 1, 0), min(TRACK, len(known))).astype(int))
    return {
        "type": 0, "pose": still_pose(), "thickness": 2.0, "scale_invariant": True,
        "points": [point(p) for p in known[picks].tolist()], "color": _colour(rgb(colour)),
        "colors": [], "indices": [],
    }  # fmt: skip


def _turned(mesh: Mesh, turn: Callable[[Array], Array]) -> Mesh:
    return replace(mesh, vertices=turn(mesh.vertices.astype(float)).astype(np.float32))


def _colour(c: Sequence[int], alpha: float = 1.0) -> dict[str, float]:
    return {"r": round(c[0] / 255, 3), "g": round(c[1] / 255, 3), "b": round(c[2] / 255, 3),
            "a": alpha}  # fmt: skip
