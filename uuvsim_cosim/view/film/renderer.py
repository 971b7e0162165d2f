"""What a camera sees of a scene in water: the C of fmus/kernels/film_batch.c over arrays."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.sensors.color_camera import REFLECTANCE, SUN, TEXTURE_SIZE
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.models.worlds.water_optics import WATERS, water_optics
from uuvsim_cosim.scene.shared.ray_casting import Caster
from uuvsim_cosim.view.scene3d.colours import BODIES, SOLIDS, rgb
from uuvsim_cosim.view.scene3d.scene import Mesh, Scene3D
from uuvsim_cosim.view.scene3d.scene_of_plan import scene_solids

__all__ = ["CLEAR", "HULL", "NOTHING", "SEABED", "SOLID", "SURFACE", "Look", "Renderer", "Seen"]

Array = NDArray[np.float64]
NOTHING, SEABED, SURFACE, SOLID, HULL = range(5)  # kinds of what a pixel shows
CLEAR = "none"  # in the place of a water type: nothing is absorbed or scattered
FARTHEST = 400.0  # m
OPENING = 0.95  # rad, from the left edge of a frame to the right
SUNWARD = np.array([0.32, -0.24, -1.0]) / np.linalg.norm([0.32, -0.24, -1.0])  # assumption
PALE = np.array([38.0, 52.0, 62.0]) / np.pi  # W/(m2 sr), background without water
MIDDLE = 0.75  # brightness of a grey plate of reflectance 0.3 beside the camera, before gamma
ADAPTED = 0.93  # share, in logarithms, of the fading daylight that the exposure makes up for


@dataclass(frozen=True, eq=False)
class Look:
    """A camera: its place (3,) [m] in `n`, and R (3, 3) from right, down, ahead to `n`."""

    eye: Array
    R: Array

    @staticmethod
    def at(eye: Array, target: Array) -> Look:
        """Return a level camera at `eye` that looks at `target`."""
        ahead = np.asarray(target, float) - eye
        length = float(np.linalg.norm(ahead))
        ahead = ahead / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
        right = np.cross([0.0, 0.0, 1.0], ahead)
        if np.linalg.norm(right) < 1e-6:  # straight up or down: north is above in the frame
            right = np.array([0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        return Look(np.asarray(eye, float), np.column_stack([right, np.cross(ahead, right), ahead]))


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame: `light` (rows, columns, 3) in W/(m2 sr), and (rows, columns) of each other."""

    light: NDArray[np.float32]
    distance: NDArray[np.float32]  # m; 0: nothing
    kind: NDArray[np.uint8]  # NOTHING, SEABED, SURFACE, SOLID or HULL
    deep: NDArray[np.float32]  # m, depth of the place that is seen


@final
class Renderer:
    """Draws frames of a scene. `caster` has the terrain and the solids of the scene.

    `water` is a type of Jerlov, or "none". `caustics` is their strength, 0 to 1. Raises
    InputInvalid for an unknown water type.
    """

    def __init__(
        self, scene3d: Scene3D, rows: int, columns: int, water: str = "II", caustics: float = 0.0
    ) -> None:
        if water not in (*WATERS, CLEAR):
            raise InputInvalid("water", f"{water!r}", expected_names(water, (*WATERS, CLEAR)))
        self.shape, self.water = (rows, columns), water
        self.focal_length = 0.5 * columns / np.tan(0.5 * OPENING)
        self.caster = Caster(_world(scene3d))
        ground = self.caster.ground
        solid = np.tile(_linear(SOLIDS["obstacle"]), (len(ground.names), 1))
        basins = [i for i, name in enumerate(ground.names) if name.startswith("basin")]
        solid[basins] = _linear(SOLIDS["basin"])
        self._solid = np.ascontiguousarray(solid.reshape(-1, 3))
        self._hulls = {b.name: Caster(_scene_of(b.name, b.hull)) for b in scene3d.bodies}
        self._bounds = {
            b.name: float(np.linalg.norm(b.hull.vertices, axis=1).max()) for b in scene3d.bodies
        }
        self._rho = {b.name: _linear(BODIES[i % len(BODIES)]) for i, b in enumerate(scene3d.bodies)}
        if water == CLEAR:
            zero = np.zeros(3)
            self.optics = (zero, zero, zero, np.asarray(SUN), zero)
        else:
            o = water_optics(water)
            self.optics = (o.beta_D, o.beta_B, o.K, np.asarray(SUN), o.V)
        self._caustics = caustics
        self._c = _library()
        self._threads = ThreadPoolExecutor(max(1, min(os.cpu_count() or 1, 16)))

    def seen(self, look: Look, poses: Mapping[str, tuple[Array, Array]], time: float) -> Seen:
        """Return what a camera sees; `poses` has place (3,) and R from `b` to `n` of each hull."""
        rows, columns = self.shape
        three, nine = ctypes.c_double * 3, ctypes.c_double * 9
        names = [n for n in self._hulls if n in poses and np.isfinite(poses[n][0]).all()]
        bodies = (_Body * max(1, len(names)))()
        for i, name in enumerate(names):
            at, R = poses[name]
            hull = ctypes.addressof(self._hulls[name].scene)
            bodies[i] = _Body(
                hull, three(*at), nine(*np.ravel(R)), three(*self._rho[name]), self._bounds[name]
            )
        background = PALE if self.water == CLEAR else np.zeros(3)
        view = _View(
            rows, columns, len(names), 0, self._solid.ctypes.data, three(*look.eye),
            nine(*np.ravel(look.R)), self.focal_length, FARTHEST,
            *(three(*each) for each in self.optics), three(*background),
            three(*REFLECTANCE["seabed"]), 0.5, TEXTURE_SIZE, self._caustics, time,
            three(*SUNWARD), 1,
        )  # fmt: skip
        seen = Seen(
            np.empty((rows, columns, 3), np.float32), np.empty((rows, columns), np.float32),
            np.empty((rows, columns), np.uint8), np.empty((rows, columns), np.float32),
        )  # fmt: skip
        planes = [a.ctypes.data for a in (seen.light, seen.distance, seen.kind, seen.deep)]

        def band(first: int) -> None:
            last = min(first + 32, rows)
            scene = ctypes.byref(self.caster.scene)
            self._c.uuv_film_rows(scene, bodies, ctypes.byref(view), first, last, *planes)

        list(self._threads.map(band, range(0, rows, 32)))
        return seen

    def exposure(self, depth: float) -> float:
        """Return the factor of a camera at this depth [m], from radiance to brightness.

        It makes up for most of the daylight that the water above takes, as a diver's eye does.
        """
        K, sun = self.optics[2], self.optics[3]
        daylight = float(np.mean(sun * np.exp(-K * max(depth, 0.0)))) / float(np.mean(sun))
        return float(MIDDLE * np.pi / (0.3 * float(np.mean(sun)) * daylight**ADAPTED))

    def picture(self, seen: Seen, depth: float) -> NDArray[np.uint8]:
        """Return a frame (rows, columns, 3) to look at: exposed, with a shoulder, with gamma."""
        bright = 1.0 - np.exp(-np.float32(1.35 * self.exposure(depth)) * seen.light)
        return np.asarray(255.0 * bright ** np.float32(1.0 / 2.2) + 0.5).astype(np.uint8)

    def projected(self, look: Look, points: Array) -> tuple[Array, Array]:
        """Return the pixels (n, 2) of points (n, 3), NaN behind the camera, and distances (n,)."""
        rows, columns = self.shape
        inside = (np.asarray(points, float) - look.eye) @ look.R
        z = np.where(inside[:, 2] > 0.05, inside[:, 2], np.nan)
        pixels = self.focal_length * inside[:, :2] / z[:, None] + 0.5 * np.array([columns, rows])
        return pixels, np.linalg.norm(inside, axis=1)


def _world(scene3d: Scene3D) -> Scene:
    """Return the terrain and the solids that rays meet: exact shapes where the run has them."""
    world = scene3d.world
    known = set() if world is None else {s.name for s in scene_solids(world)}
    own = tuple(_placed(s.name, s.mesh) for s in scene3d.solids if s.name not in known)
    terrain = scene3d.terrain
    if terrain is None and scene3d.bottom is not None:
        level = np.full((2, 2), scene3d.bottom, np.float32)
        terrain = Terrain(level, 20e3, (-10e3, -10e3))
    obstacles, meshes = ((), ()) if world is None else (world.obstacles, world.meshes)
    return Scene(scene3d.name, terrain, obstacles, meshes=(*meshes, *own))


def _scene_of(name: str, mesh: Mesh) -> Scene:
    return Scene(name, None, meshes=(_placed(name, mesh),))


def _placed(name: str, mesh: Mesh) -> PlacedMesh:
    corners = mesh.faces.astype(np.int32)
    at = (0.0, 0.0, 0.0)
    return PlacedMesh(Path(name), mesh.vertices.astype(float), corners, at, name=name)


def _linear(colour: str) -> Array:
    """Return a colour as reflectances."""
    return np.asarray((np.array(rgb(colour)) / 255.0) ** 2.2)


class _Body(ctypes.Structure):
    """film_body."""

    _fields_ = (
        ("hull", ctypes.c_void_p),
        *((name, ctypes.c_double * n) for name, n in (("at", 3), ("R", 9), ("rho", 3))),
        ("bound", ctypes.c_double),
    )


class _View(ctypes.Structure):
    """film_view."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("rows", "columns", "n_bodies", "pad")),
        ("solid", ctypes.c_void_p),
        *((name, ctypes.c_double * n) for name, n in (("eye", 3), ("R", 9))),
        *((name, ctypes.c_double) for name in ("focal_length", "farthest")),
        *(
            (name, ctypes.c_double * 3)
            for name in ("beta_D", "beta_B", "K", "sun", "V", "background", "seabed")
        ),
        *((name, ctypes.c_double) for name in ("contrast", "texture_size", "caustics", "time")),
        ("sunward", ctypes.c_double * 3),
        ("seed", ctypes.c_uint64),
    )


@lru_cache
def _library() -> ctypes.CDLL:
    source = content("fmus", "kernels") / "film_batch.c"
    c = ctypes.CDLL(str(compile_shared([source], name="film_batch", include=runtime())))
    pointer = ctypes.c_void_p
    c.uuv_film_rows.argtypes = [pointer] * 3 + [ctypes.c_int] * 2 + [pointer] * 4
    c.uuv_film_rows.restype = None
    return c
