"""Images of a colour camera over arrays of poses, by the same C code that components use."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.camera_data import camera_arrays, camera_numbers
from uuvsim_cosim.fmus.codegen.processor import processor_flags
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.sensors.color_camera import REFLECTANCE, SUN, TEXTURE_SIZE
from uuvsim_cosim.models.worlds.camera_image import (
    CAMERA_HEAD,
    CAMERA_LAMP,
    LAMPS,
    WATER_INDEX,
    CameraImage,
)
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.models.worlds.water_optics import WaterOptics, water_optics
from uuvsim_cosim.scene.shared.ray_casting import Caster

__all__ = ["Camera", "Images", "Lamp"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lamp:
    """A lamp beside the camera, in the camera's axes: x to the right, y down, z along the view."""

    position: tuple[float, float, float]  # m
    intensity: tuple[float, float, float]  # W/sr in red, green and blue
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    inner: float = 1.0  # rad, half angle up to which the intensity is whole
    outer: float = 1.1  # rad, half angle from which it is 0


@dataclass(frozen=True, eq=False)
class Images:
    """Images of n poses: arrays by [pose][row][column], with red, green and blue last."""

    image: NDArray[np.uint8]  # grey levels, in linear light
    radiance: Array  # W/(m2 sr), without noise
    depth: NDArray[np.float32]  # m, along the view; 0: nothing
    label: NDArray[np.uint16]  # 0: nothing, 1: seabed, 2 + i: solid or mesh i
    normal: NDArray[np.float32]  # of the surface, in the camera's axes; 0: nothing


@final
class Camera:
    """A camera in a scene. `images` computes what it shows from each of many poses.

    `scene` is a scene, a terrain alone, or the value of the option `scene` of a component.
    `focal_length` is in pixels, `distortion` k1 and k2, `water` a type of Jerlov or coefficients.
    A flat port at the distance `port` [m] before the lens refracts; its focal length is in air.
    Without one, it is in water. Row i of m is exposed (m - 1 - i) `row_time` seconds before the
    pose.
    A pixel collects `sensitivity` electrons per W/(m2 sr); `gain` is in grey levels an electron.
    Reflectances are of red, green and blue, `solids` (n, 3) of each solid and mesh.

    Raises InputInvalid for a focal length or a number of pixels that is not more than 0, and for a
    water type that is not known.
    """

    def __init__(
        self,
        scene: Scene | Terrain | str,
        *,
        columns: int = 320,
        rows: int = 240,
        focal_length: float = 190.0,
        distortion: tuple[float, float] = (0.0, 0.0),
        water: str | WaterOptics = "II",
        sun: Sequence[float] = SUN,
        lamps: Sequence[Lamp] = (),
        asymmetry: float = 0.924,
        seabed: Sequence[float] = REFLECTANCE["seabed"],
        solids: ArrayLike | None = None,
        contrast: float = 0.5,
        texture_seed: int = 1,
        farthest: float = 50.0,
        port: float | None = None,
        row_time: float = 0.0,
        sensitivity: float = 1200.0,
        read_noise: float = 3.0,
        gain: float = 0.051,
        noise: bool = True,
    ) -> None:
        if not (columns > 0 and rows > 0 and 0.0 < focal_length < float("inf")):
            raise InputInvalid(
                "camera",
                f"{columns} x {rows} pixels, focal length {focal_length:g} pixels",
                "more than 0",
            )
        if port is not None and not 0.0 <= port < float("inf"):
            raise InputInvalid("camera", f"port at {port:g} m", "0 m or more before the lens")
        if not 0.0 <= row_time < float("inf"):
            raise InputInvalid("camera", f"row_time = {row_time:g} s", "0 s or more")
        if len(lamps) > LAMPS:
            raise InputInvalid("camera", f"{len(lamps)} lamps", f"{LAMPS} at most")
        self.shape = rows, columns
        self._caster = Caster(scene)
        ground = self._caster.ground
        if solids is None:
            solids = np.tile(REFLECTANCE["solid"], (len(ground.names), 1))
        rho = np.asarray(solids, float).reshape(-1, 3)
        if len(rho) != len(ground.names):
            raise InputInvalid("camera", f"{len(rho)} reflectances", f"{len(ground.names)}")
        image = CameraImage(
            "camera", ground, rows, columns, len(lamps), 0, farthest, TEXTURE_SIZE, texture_seed,
            np.asarray(seabed, float), rho, True, True, True,
        )  # fmt: skip
        counts, lengths, seed = camera_numbers(image)
        self._arrays = {k: np.ascontiguousarray(a) for k, a in camera_arrays(image).items()}
        pointers = [a.ctypes.data if a.size else None for a in self._arrays.values()]
        self._camera = _CameraStruct(*counts, *lengths, seed, *pointers)
        self._c = _library()
        optics = water_optics(water) if isinstance(water, str) else water
        colours = (optics.beta_D, optics.beta_B, optics.K, sun, optics.V, optics.b)
        self._numbers = np.concatenate([
            [focal_length, *distortion], *colours,
            [asymmetry, contrast, sensitivity, read_noise, gain, float(noise)],
        ])  # fmt: skip
        self._shutter = np.array([1.0 if port is None else WATER_INDEX, port or 0.0, row_time])
        self._lamps = tuple(lamps)

    def arguments(
        self,
        positions: ArrayLike,
        rotations: ArrayLike,
        seed: int = 0,
        velocities: ArrayLike = (0.0,) * 6,
    ) -> Array:
        """Return the arguments (n, n_in) of the images; see fmus/runtime/worlds/uuv_camera.h."""
        p = np.asarray(positions, float).reshape(-1, 3)
        R = np.broadcast_to(np.asarray(rotations, float), (len(p), 3, 3))
        draws = np.random.default_rng(seed).standard_normal((len(p), 2))
        shutter = np.tile(self._shutter, (len(p), 1))
        moves = np.broadcast_to(np.asarray(velocities, float), (len(p), 6))
        x = [p, R.reshape(-1, 9), np.tile(self._numbers, (len(p), 1)), draws, shutter, moves]
        assert sum(each.shape[1] for each in x) == CAMERA_HEAD
        for lamp in self._lamps:
            cones = np.cos([lamp.inner, lamp.outer])
            x += [p + R @ lamp.position, R @ lamp.axis]
            x.append(np.tile([*lamp.intensity, *cones], (len(p), 1)))
        found = np.ascontiguousarray(np.hstack(x))
        assert found.shape[1] == CAMERA_HEAD + CAMERA_LAMP * len(self._lamps)
        return found

    def images(
        self,
        positions: ArrayLike,
        rotations: ArrayLike,
        seed: int = 0,
        velocities: ArrayLike = (0.0,) * 6,
    ) -> Images:
        """Return the images from `positions` (n, 3) [m] in `n`, and by `rotations` (n, 3, 3).

        A rotation turns vectors of the instrument into `n`. `seed` is that of the noise alone.
        `velocities` (n, 6) are those of the camera [m/s] and its rotation [rad/s], both in `n`:
        only a rolling shutter shows them.
        Raises InputInvalid for a place that is above the water, below the seabed, in an obstacle
        or not finite, and for images that do not fit into memory.
        """
        x = self.arguments(positions, rotations, seed, velocities)
        self._check(x[:, :3])
        n, pixels = len(x), self.shape[0] * self.shape[1]
        try:
            room = np.empty(3 * pixels, np.float32)
            found = Images(
                np.empty((n, *self.shape, 3), np.uint8),
                np.empty((n, *self.shape, 3)),
                np.empty((n, *self.shape), np.float32),
                np.empty((n, *self.shape), np.uint16),
                np.empty((n, *self.shape, 3), np.float32),
            )
        except (MemoryError, ValueError):
            rows, columns = self.shape
            raise InputInvalid(
                "camera",
                f"{n} images of {columns} x {rows} pixels",
                f"images that fit into memory; these need {n * pixels * 45 / 2**30:,.0f} GiB",
            ) from None
        self._c.uuv_camera_batch(
            ctypes.byref(self._caster.scene), ctypes.byref(self._camera), x.ctypes.data,
            x.shape[1], n, room.ctypes.data, found.image.ctypes.data, found.radiance.ctypes.data,
            found.depth.ctypes.data, found.label.ctypes.data, found.normal.ctypes.data,
        )  # fmt: skip
        return found

    def _check(self, places: Array) -> None:
        ground = self._caster.ground
        bed = self._caster.height(places[:, 0], places[:, 1])
        inside = self._caster.inside(places) if len(ground.solids) else np.full(len(places), -1)
        for k, place in enumerate(places):
            wrong = ""
            if not np.isfinite(place).all():
                wrong = "is not finite"
            elif place[2] < 0.0:
                wrong = "is above the water"
            elif place[2] > bed[k]:
                wrong = f"is below the seabed at {bed[k]:g} m"
            elif inside[k] >= 0:
                wrong = f"is in the obstacle {ground.names[inside[k]] or f'number {inside[k]}'}"
            if wrong:
                at = ", ".join(f"{v:g}" for v in place)
                raise InputInvalid(
                    f"camera at place {k}", f"({at}) m {wrong}", "a place in the water"
                )


class _CameraStruct(ctypes.Structure):
    """uuv_camera."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("rows", "columns", "lamps", "n_moving")),
        *((name, ctypes.c_double) for name in ("farthest", "texture_size")),
        ("texture_seed", ctypes.c_uint64),
        *((name, ctypes.c_void_p) for name in ("seabed", "solid", "points", "normal")),
    )


@lru_cache
def _library() -> ctypes.CDLL:
    source = content("fmus", "kernels") / "camera_batch.c"
    flags = processor_flags(baseline=False)
    return opened(compile_shared([source], name="camera_batch", include=runtime(), flags=flags))


def opened(library: Path) -> ctypes.CDLL:
    """Load a compiled ``camera_batch.c``."""
    c = ctypes.CDLL(str(library))
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    c.uuv_camera_batch.argtypes = [pointer, pointer, pointer, count, count, *[pointer] * 6]
    c.uuv_camera_batch.restype = None
    return c
