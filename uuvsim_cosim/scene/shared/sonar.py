"""Images of a sonar over arrays of poses, by the same C code that components use."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.sonar_data import sonar_arrays, sonar_numbers
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.sonar_geometry import SonarGeometry
from uuvsim_cosim.models.worlds.sonar_image import SONAR_HEAD, SonarImage, Surfaces, check_surfaces
from uuvsim_cosim.models.worlds.sonar_path import STRAIGHT, SonarPaths
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.shared.ray_casting import Caster

__all__ = ["Echoes", "Sonar", "Ways"]

Array = NDArray[np.float64]
DB = np.log(10.0) / 20.0


@dataclass(frozen=True, eq=False)
class Echoes:
    """Images of n poses: arrays by [pose][beam][bin], with the axes of the geometry."""

    magnitude: NDArray[np.float32]  # Pa, with the gain over range
    pressure: NDArray[np.complex64]  # Pa, with the gain over range
    label: NDArray[np.uint16]  # 0: no echo, 1: seabed, 2 + i: solid or mesh i
    range: NDArray[np.float32]  # m, (poses, beams): of the strongest echo, 0: none
    echo: NDArray[np.float32]  # Pa, (poses, beams): its magnitude


@dataclass(frozen=True, eq=False)
class Ways:
    """Where n rays end: what `Sonar.ways` returns."""

    places: Array  # (n, 3) m, in `n`
    directions: Array  # (n, 3) unit vectors there
    length: Array  # (n,) m, along the path
    range: Array  # (n,) m: travel time one way, times the speed that the instrument assumes
    spread: Array  # (n,) m: distance at which a straight ray has the same level
    kind: NDArray[np.int_]  # (n,) 0: nothing, 1: seabed, 3: surface, 4 + i: solid or mesh i


@final
class Sonar:
    """A sonar in a scene. `images` computes what it shows from each of many poses.

    `scene` is a scene, a terrain alone, or the value of the option `scene` of a component. Levels
    are in dB re 1 uPa (at 1 m), the frequency in Hz, the absorption in dB/m; `tvg` is the gain in
    `tvg` log r, a multiple of 10 up to 40. `paths` bend and reflect the rays.
    """

    def __init__(
        self,
        scene: Scene | Terrain | str,
        geometry: SonarGeometry,
        surfaces: Surfaces,
        *,
        frequency: float,
        source_level: float = 220.0,
        noise_level: float = -np.inf,
        absorption: float = 0.0,
        sound_speed: float = 1500.0,
        tvg: int = 0,
        paths: SonarPaths | None = None,
    ) -> None:
        if tvg not in (0, 10, 20, 30, 40):
            raise InputInvalid("sonar", f"tvg {tvg}", "0, 10, 20, 30 or 40")
        paths = paths or STRAIGHT
        self.geometry = g = geometry
        self._caster = Caster(scene)
        check_surfaces(self._caster.ground, surfaces, 0)
        image = SonarImage(
            "sonar", self._caster.ground, g, surfaces, tvg // 10, 0, True, True, paths
        )
        whole, lengths, power = sonar_numbers(image)
        self._arrays = {k: np.ascontiguousarray(a) for k, a in sonar_arrays(image).items()}
        pointers = {k: a.ctypes.data if a.size else None for k, a in self._arrays.items()}
        profile = (len(paths.level), paths.chord, pointers.pop("level"))
        self._sonar = _SonarStruct(*whole, *lengths, power, *pointers.values(), *profile)
        self._c = _library()
        self._room = np.empty(self._c.uuv_sonar_room(ctypes.byref(self._sonar), 1), np.float32)
        cell, nearest, alpha = g.step / g.fine, g.first - g.pad * g.step, absorption
        level = source_level - 2.0 * alpha * (nearest + 0.5 * cell)
        self._numbers = [
            2.0 * frequency / sound_speed,
            1e-6 * np.exp(DB * level),
            np.exp(-2.0 * DB * alpha * cell),
            1e-6 * np.exp(DB * noise_level),
            np.exp(2.0 * DB * alpha * (g.first + 0.5 * g.step)) if tvg else 1.0,
            np.exp(2.0 * DB * alpha * g.step) if tvg else 1.0,
            4.0,
        ]
        self._speed = sound_speed

    def images(self, positions: ArrayLike, rotations: ArrayLike, seed: int = 0) -> Echoes:
        """Return the images from `positions` (n, 3) [m] in `n`, and by `rotations` (n, 3, 3).

        A rotation turns vectors of the instrument into `n`. `seed` is that of the noise alone.
        Raises InputInvalid for a place that is above the water, in an obstacle or not finite.
        """
        p = np.asarray(positions, float).reshape(-1, 3)
        R = np.broadcast_to(np.asarray(rotations, float), (len(p), 3, 3))
        self._check(p)
        g = self.geometry
        n, beams, pixels = len(p), len(g.bearings), len(g.bearings) * g.bins
        draws = np.random.default_rng(seed).standard_normal((n, 2))
        numbers = np.broadcast_to(self._numbers, (n, len(self._numbers)))
        speed = np.full((n, 1), self._speed)
        x = np.ascontiguousarray(np.hstack([p, R.reshape(n, 9), numbers, draws, speed]))
        assert x.shape[1] == SONAR_HEAD
        seen = np.empty((n, pixels + 2 * beams + 2), np.float32)
        parts = np.empty((n, 2, beams, g.bins), np.float32)
        label = np.empty((n, beams, g.bins), np.uint16)
        self._c.uuv_sonar_batch(
            ctypes.byref(self._caster.scene), ctypes.byref(self._sonar), x.ctypes.data,
            x.shape[1], n, self._room.ctypes.data, seen.ctypes.data, parts.ctypes.data,
            label.ctypes.data,
        )  # fmt: skip
        magnitude = seen[:, :pixels].reshape(n, beams, g.bins)
        pressure = (parts[:, 0] + 1j * parts[:, 1]).astype(np.complex64)
        ranges, echoes = (seen[:, pixels + k * beams : pixels + (k + 1) * beams] for k in (0, 1))
        return Echoes(magnitude, pressure, label, ranges, echoes)

    def ways(self, place: ArrayLike, directions: ArrayLike, bounces: int = 0) -> Ways:
        """Return where rays end that leave a `place` (3,) [m] in `directions` (n, 3) in `n`.

        With one of `bounces`, a ray goes on from what reflects it. Raises InputInvalid for a place
        that `images` refuses.
        """
        d = np.asarray(directions, float).reshape(-1, 3)
        self._check(np.asarray(place, float).reshape(1, 3))
        d = d / np.linalg.norm(d, axis=1)[:, None]
        x = np.ascontiguousarray(np.hstack([np.broadcast_to(place, d.shape), d]))
        y = np.empty((len(d), 10))
        self._c.uuv_sonar_ways(
            ctypes.byref(self._caster.scene), ctypes.byref(self._sonar), self._speed, 1 + bounces,
            x.ctypes.data, len(d), y.ctypes.data,
        )  # fmt: skip
        return Ways(y[:, :3], y[:, 3:6], y[:, 6], y[:, 7], y[:, 8], y[:, 9].astype(int))

    def _check(self, places: Array) -> None:
        bad = np.flatnonzero(~np.isfinite(places).all(axis=1) | ~(places[:, 2] >= 0.0))
        if len(bad):
            at = ", ".join(f"{x:g}" for x in places[bad[0]])
            raise InputInvalid(
                f"sonar at place {bad[0]}",
                f"({at}) m",
                "finite numbers, and D of 0 or more: in water",
            )
        inside = self._caster.inside(places) if len(self._caster.ground.solids) else np.array([-1])
        if (inside >= 0).any():
            first = int(np.argmax(inside >= 0))
            name = self._caster.ground.names[inside[first]] or f"number {inside[first]}"
            at = ", ".join(f"{x:g}" for x in places[first])
            raise InputInvalid(
                f"sonar at place {first}",
                f"({at}) m is in the obstacle {name}",
                "a place in the water",
            )


class _SonarStruct(ctypes.Structure):
    """uuv_sonar."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("beams", "bins", "columns", "rays", "fine", "pad")),
        ("n_moving", ctypes.c_int),
        *((name, ctypes.c_double) for name in ("first", "step", "farthest", "d_theta")),
        ("tvg", ctypes.c_int),
        *(
            (name, ctypes.c_void_p)
            for name in (
                "column", "ray", "weight", "window", "nearest", "pulse", "strength", "seabed",
                "solid", "surface", "bottom", "turns", "amplitudes",
            )
        ),
        ("levels", ctypes.c_int),
        ("chord", ctypes.c_double),
        ("level", ctypes.c_void_p),
    )  # fmt: skip


@lru_cache
def _library() -> ctypes.CDLL:
    source = content("fmus", "kernels") / "sonar_batch.c"
    return opened(compile_shared([source], name="sonar_batch", include=runtime()))


def opened(library: Path) -> ctypes.CDLL:
    """Load a compiled ``sonar_batch.c``."""
    c = ctypes.CDLL(str(library))
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    c.uuv_sonar_room.argtypes = [pointer, ctypes.c_int]
    c.uuv_sonar_room.restype = count
    c.uuv_sonar_batch.argtypes = [*[pointer] * 3, count, count, *[pointer] * 4]
    c.uuv_sonar_batch.restype = None
    number = ctypes.c_double
    c.uuv_sonar_ways.argtypes = [pointer, pointer, number, ctypes.c_int, pointer, count, pointer]
    c.uuv_sonar_ways.restype = None
    return c
