"""A scene as the caster reads it: float32 nodes with their pyramid, and solids as rows of numbers.

`scene_named` finds the scene that a declaration's option names; `ground_of` packs it for
fmus/runtime/uuv_cast.h, which a component's C and `uuvsim_cosim.scene.cast` read alike.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from math import cos, hypot, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.scene import Scene, find_scene, load_scene
from uuvsim_cosim.models.terrain import Terrain, load_terrain

__all__ = ["BASE", "Ground", "ground_named", "ground_of", "scene_named"]

BASE = 3  # the pyramid's finest level, of 2^BASE cells a side: UUV_TERRAIN_BASE
ROW = 10  # numbers of a solid: kind, centre (3), size (5), radius of the ball that holds it
_KINDS = {"Box": 0.0, "Sphere": 1.0, "Capsule": 2.0, "Cylinder": 3.0}  # enum uuv_solid_kind


@dataclass(frozen=True, eq=False)
class Ground:
    """A scene's terrain and solids, packed; `name` holds the hash of the contents."""

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
    names: tuple[str, ...]  # of the solids


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
    """Pack the scene that an option names; its files are read again only where they changed."""
    files: list[Path] = []
    if scene.endswith(".npz"):
        files = [Path(scene).expanduser()]
    elif scene != "flat":
        files = sorted(f for f in find_scene(scene).iterdir() if f.is_file())
    stamps = [(f.stat().st_mtime_ns, f.stat().st_size) for f in files if f.is_file()]
    return _kept(scene, tuple(stamps))


@lru_cache(maxsize=8)
def _kept(scene: str, stamps: tuple[tuple[int, int], ...]) -> Ground:
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
            raise InputInvalid(f"terrain: {what}; expected finite depths, NaN where unknown")
        spacing, origin = float(terrain.spacing), terrain.origin
        low, high = float(np.nanmin(z)), float(np.nanmax(z))
        ranges, at, wide = _pyramid(z)
    digest = hashlib.sha256(f"{z.shape} {spacing!r} {origin!r} ".encode())
    digest.update(z.astype("<f4").tobytes() + solids.astype("<f8").tobytes())
    names = tuple(o.name for o in obstacles)
    name = f"scene_{digest.hexdigest()[:12]}"
    return Ground(name, z, spacing, origin, low, high, ranges, at, wide, solids, names)


def capsule_row(half: NDArray[np.float64], radius: float) -> list[float]:
    """Give the size of a capsule from its middle half the way to an end (3), and its radius."""
    return [*half.tolist(), radius, 0.0]


def _row(o: Obstacle) -> list[float]:
    """Give kind, centre, size and bound of a solid; raises InputInvalid for one without size."""
    kind = _KINDS[type(o).__name__]
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
        size, bound = capsule_row(half, o.radius), hypot(*half) + o.radius
        return [kind, *((start + end) / 2).tolist(), *size, bound]
    else:
        assert isinstance(o, Cylinder)
        sizes = (o.radius, o.half_height)
        size, bound = [*sizes, 0.0, 0.0, 0.0], hypot(*sizes)
    if not min(sizes) > 0:
        raise InputInvalid(f"obstacle {o}: its sizes must be greater than 0 m")
    return [kind, *o.centre, *size, bound]


def _pyramid(
    z: NDArray[np.float32],
) -> tuple[NDArray[np.float32], tuple[int, ...], tuple[int, ...]]:
    """Give the ranges of squares of 2^level cells, level by level from BASE up to one square."""
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
