"""A scene as the ray caster reads it: float32 nodes with their pyramid, solids as rows of numbers.

`scene_named` finds the scene that a declaration's option names; `ground_of` packs it for
fmus/runtime/worlds/uuv_cast.h, which a component's C and `uuvsim_cosim.scene.Caster` read alike.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import partial
from math import cos, hypot, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.declaration.files_read import noted, shared_until_changed
from uuvsim_cosim.models.shapes.tree import Tree, tree_of
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh, unique_rows
from uuvsim_cosim.models.worlds.scene import Scene, find_scene, load_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, load_terrain

__all__ = [
    "BASE",
    "Ground",
    "Surfaces",
    "ground_named",
    "ground_of",
    "scene_named",
    "touched_ground",
]

BASE = 3  # the pyramid's finest level, of 2^BASE cells a side: UUV_TERRAIN_BASE
ROW = 10  # numbers of a solid: shape, centre (3), size (5), radius of the ball that holds it
_SHAPES = {"Box": 0.0, "Sphere": 1.0, "Capsule": 2.0, "Cylinder": 3.0}  # enum uuv_solid_kind


@dataclass(frozen=True, eq=False)
class Surfaces:
    """The triangles of all meshes of a scene, one mesh after the other."""

    middle: tuple[float, float, float]  # m, N E D that vertices are relative to
    vertices: NDArray[np.float32]  # (m, 3) m, each once
    corners: NDArray[np.int32]  # (n, 3) vertices of each triangle, anticlockwise from outside
    first: NDArray[np.int32]  # (meshes + 1) first triangle of each mesh, and n
    touched: tuple[str, ...] = ()  # meshes that a hull may not pass through

    @property
    def triangles(self) -> NDArray[np.float64]:
        """Return the corners (n, 3, 3) in `n` [m]."""
        return np.asarray(self.vertices.astype(float)[self.corners] + self.middle)


@dataclass(frozen=True, eq=False)
class Ground:
    """A scene's terrain, solids and meshes, packed; `name` holds the hash of the contents."""

    name: str
    z: NDArray[np.float32]  # (rows, columns) m, positive down, NaN: hole; (0, 0): no terrain
    spacing: float  # m
    origin: tuple[float, float]  # m, N and E of node (0, 0)
    low: float  # m, least and greatest z
    high: float
    ranges: NDArray[np.float32]  # (squares, 2) least and greatest z, level by level from BASE on
    at: tuple[int, ...]  # first square of each level, from 0 on
    wide: tuple[int, ...]  # squares a row of each level
    solids: NDArray[np.float64]  # (n, ROW)
    names: tuple[str, ...]  # of the solids, then of the meshes
    surfaces: Surfaces
    tree: Tree  # over the solids, then the triangles
    friction: tuple[float | None, ...] = ()  # of each solid, where it is stated


def scene_named(scene: str) -> Scene:
    """Find a scene by id, folder or scene.yaml, or make one of a terrain's file (.npz).

    "flat" is a level seabed of 20 km by 20 km at 25 m.
    """
    if scene == "flat":
        level = np.full((2, 2), 25.0, np.float32)
        return Scene("flat", Terrain(level, 20e3, (-10e3, -10e3)), source="level, at 25 m")
    if scene.endswith(".npz"):
        path = Path(scene).expanduser()
        return Scene(path.stem, load_terrain(path))
    return load_scene(scene)


def ground_named(scene: str) -> Ground:
    """Pack the scene that an option names; it is read again after a change of one of its files."""
    return _shared(scene)


def touched_ground(scene: str) -> Ground:
    """Pack a scene for contact, which ignores meshes: each needs `contact: false`."""
    ground = ground_named(scene)
    if ground.surfaces.touched:
        raise ParameterInvalid(
            f"scene {scene}",
            "contact does not act between a hull and meshes "
            f"({', '.join(ground.surfaces.touched)})",
            (
                "obstacles where a hull may touch, and contact: false at each mesh "
                "that it may pass through"
            ),
        )
    return ground


@partial(shared_until_changed, most=8)
def _shared(scene: str) -> Ground:
    if scene != "flat" and not scene.endswith(".npz"):
        for file in find_scene(scene).iterdir():
            noted(file)
    return ground_of(scene_named(scene))


def ground_of(scene: Scene | Terrain) -> Ground:
    """Pack a scene, or a terrain alone; raises InputInvalid where there is nothing in it."""
    terrain = scene if isinstance(scene, Terrain) else scene.terrain
    obstacles = () if isinstance(scene, Terrain) else scene.obstacles
    solids = np.array([_row(o) for o in obstacles]).reshape(-1, ROW)
    if not np.all(np.isfinite(solids)):
        bad = next(o for o, r in zip(obstacles, solids, strict=True) if not np.all(np.isfinite(r)))
        raise InputInvalid(f"obstacle {bad}: a number is not finite")
    z = np.zeros((0, 0), np.float32)
    spacing, origin, low, high = 1.0, (0.0, 0.0), 0.0, 0.0
    ranges = np.zeros((0, 2), np.float32)
    at: tuple[int, ...] = (0,)
    wide: tuple[int, ...] = (0,)
    if terrain is not None:
        z = np.ascontiguousarray(terrain.z, np.float32)
        if np.isinf(z).any() or np.isnan(z).all():
            what = "nothing but holes" if np.isnan(z).all() else "infinite depths"
            raise InputInvalid("terrain", what, "finite depths, NaN where unknown")
        spacing, origin = float(terrain.spacing), terrain.origin
        low, high = float(np.nanmin(z)), float(np.nanmax(z))
        ranges, at, wide = _pyramid(z)
    meshes = () if isinstance(scene, Terrain) else scene.meshes
    surfaces = _surfaces(meshes)
    digest = hashlib.sha256(f"{z.shape} {spacing!r} {origin!r} ".encode())
    digest.update(z.astype("<f4").tobytes() + solids.astype("<f8").tobytes())
    if meshes:
        digest.update(f" {surfaces.middle!r} {surfaces.first.tolist()} ".encode())
        digest.update(surfaces.vertices.astype("<f4").tobytes())
        digest.update(surfaces.corners.astype("<i4").tobytes())
    names = tuple(o.name for o in (*obstacles, *meshes))
    name = f"scene_{digest.hexdigest()[:12]}"
    tree = tree_of(*_boxes(solids, surfaces))
    return Ground(
        name, z, spacing, origin, low, high, ranges, at, wide, solids, names, surfaces, tree,
        tuple(o.friction for o in obstacles),
    )  # fmt: skip


def _surfaces(meshes: tuple[PlacedMesh, ...]) -> Surfaces:
    """Pack meshes; triangles whose corners fall together in float32 are left out."""
    if not meshes:
        nothing = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
        return Surfaces((0.0, 0.0, 0.0), *nothing, np.zeros(1, np.int32))
    every = np.concatenate([m.vertices for m in meshes])
    middle = np.round(0.5 * (every.min(axis=0) + every.max(axis=0)))
    before = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    corners = np.concatenate([m.corners + k for m, k in zip(meshes, before, strict=False)])
    owner = np.repeat(np.arange(len(meshes)), [len(m.corners) for m in meshes])
    vertices, same = unique_rows((every - middle).astype(np.float32))
    corners = same[corners]
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    first = np.searchsorted(owner[whole], np.arange(len(meshes) + 1))
    north, east, down = middle.tolist()
    touched = tuple(m.name or m.file.name for m in meshes if m.contact)
    kept = corners[whole].astype(np.int32), first.astype(np.int32)
    return Surfaces((north, east, down), vertices, *kept, touched)


def _boxes(
    solids: NDArray[np.float64], surfaces: Surfaces
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and the greatest N, E, D of each solid and triangle, with a margin.

    It is much more than a computed hit is beside the surface by rounding. A ray from p m away
    may graze a round solid of radius r that it misses by 1e-15 p²/r: 0.2 mm of 5 cm at 100 km.
    """
    size, half = solids[:, 4:9], np.zeros((len(solids), 3))
    for shape, row in enumerate(
        (
            np.stack(
                [
                    np.abs(size[:, 3]) * size[:, 0] + np.abs(size[:, 4]) * size[:, 1],
                    np.abs(size[:, 4]) * size[:, 0] + np.abs(size[:, 3]) * size[:, 1],
                    size[:, 2],
                ],
                axis=1,
            ),
            size[:, [0, 0, 0]],
            np.abs(size[:, :3]) + size[:, 3:4],
            size[:, [0, 0, 1]],
        )
    ):
        half = np.where(solids[:, :1] == shape, row, half)
    half += 1e-3 + 1e-3 * solids[:, 9:10]
    corners = surfaces.triangles
    low, high = corners.min(axis=1), corners.max(axis=1)
    margin = 1e-5 + 1e-6 * (high - low).max(axis=1, keepdims=True, initial=0.0)
    return (
        np.concatenate([solids[:, 1:4] - half, low - margin]),
        np.concatenate([solids[:, 1:4] + half, high + margin]),
    )


def _row(o: Obstacle) -> list[float]:
    """Return shape, centre, size and bound of a solid; raises InputInvalid for one without size."""
    shape = _SHAPES[type(o).__name__]
    sizes: tuple[float, ...]
    if isinstance(o, Box):
        sizes = o.half
        size, bound = [*o.half, cos(o.yaw), sin(o.yaw)], hypot(*o.half)
    elif isinstance(o, Sphere):
        sizes = (o.radius,)
        size, bound = [o.radius, 0.0, 0.0, 0.0, 0.0], o.radius
    elif isinstance(o, Capsule):
        sizes = (o.radius,)
        start, end = np.array(o.start), np.array(o.end)
        half = (end - start) / 2
        size, bound = [*half.tolist(), o.radius, 0.0], hypot(*half) + o.radius
        return [shape, *((start + end) / 2).tolist(), *size, bound]
    else:
        assert isinstance(o, Cylinder)
        sizes = (o.radius, o.half_height)
        size, bound = [*sizes, 0.0, 0.0, 0.0], hypot(*sizes)
    if not min(sizes) > 0:
        raise InputInvalid(f"obstacle {o}: its sizes must be greater than 0 m")
    return [shape, *o.centre, *size, bound]


def _pyramid(
    z: NDArray[np.float32],
) -> tuple[NDArray[np.float32], tuple[int, ...], tuple[int, ...]]:
    """Return the ranges of squares of 2^level cells, level by level from BASE up to one square."""
    low, high = np.where(np.isnan(z), np.inf, z), np.where(np.isnan(z), -np.inf, z)
    low = np.minimum(np.minimum(low[:-1, :-1], low[1:, :-1]), np.minimum(low[:-1, 1:], low[1:, 1:]))
    high = np.maximum(
        np.maximum(high[:-1, :-1], high[1:, :-1]), np.maximum(high[:-1, 1:], high[1:, 1:])
    )
    parts: list[NDArray[np.float32]] = []
    at, wide, level, first = [0] * BASE, [0] * BASE, 0, 0
    while level < BASE or low.size > 1:
        low, high = _halved(low, np.inf, np.minimum), _halved(high, -np.inf, np.maximum)
        level += 1
        if level >= BASE:
            at.append(first)
            wide.append(low.shape[1])
            parts.append(np.stack([low.ravel(), high.ravel()], axis=1).astype(np.float32))
            first += low.size
            if low.size == 1:
                break
    return np.concatenate(parts), tuple(at), tuple(wide)


def _halved(values: NDArray[np.float64], fill: float, of: np.ufunc) -> NDArray[np.float64]:
    rows, columns = values.shape
    padded = np.pad(values, ((0, rows % 2), (0, columns % 2)), constant_values=fill)
    across = of(padded[0::2], padded[1::2])
    return np.asarray(of(across[:, 0::2], across[:, 1::2]))
