"""Colour image of a camera as an intrinsic: one call in the equations for all its pixels.

FMUs, native components and kernels evaluate it by fmus/runtime/worlds/uuv_camera.h, which states
the model. CasADi itself evaluates it in numpy, with rays by brute force (ray_reference.py).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from statistics import NormalDist

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.intrinsics.network import registered
from uuvsim_cosim.models.worlds.ground import Ground
from uuvsim_cosim.models.worlds.ray_reference import first_hit
from uuvsim_cosim.models.worlds.rays import MOVING, moving_solids

__all__ = [
    "CAMERA_HEAD",
    "CAMERA_LAMP",
    "LAMPS",
    "NORMALS",
    "POINTS",
    "WATER_INDEX",
    "CameraImage",
    "camera_image",
]

Array = NDArray[np.float64]
CAMERA_HEAD = 50  # UUV_CAMERA_HEAD
CAMERA_LAMP = 11  # UUV_CAMERA_LAMP
LAMPS = 16  # UUV_CAMERA_LAMPS
WATER_INDEX = 1.34  # UUV_CAMERA_WATER: refractive index of sea water over that of air
ENTERS = 0.93248938778672  # UUV_CAMERA_ENTERS: share of a uniform sky's light that enters the water
NEAR = 1e-9  # UUV_CAMERA_NEAR
OCTAVES = 4  # UUV_CAMERA_OCTAVES
TABLE = 4096  # UUV_SONAR_TABLE
WORD = 2**64
POINTS = np.round(np.stack(np.polynomial.legendre.leggauss(8), axis=1), 14)  # UUV_CAMERA_POINTS
_QUANTILES = np.array([NormalDist().inv_cdf((i + 0.5) / TABLE) for i in range(TABLE)])
NORMALS = np.round(_QUANTILES / _QUANTILES.std(), 6).astype(np.float32)


@dataclass(frozen=True, eq=False)
class CameraImage:
    """Grey levels [row][column][channel], their mean, share of the brightest, pixels with a hit.

    Depths and labels [row][column] and normals [row][column][axis] follow, where they are asked
    for. The reflectance of a surface is that of `seabed` (3,), or of `solids` (n, 3): solids,
    meshes and movers.
    """

    name: str
    ground: Ground
    rows: int
    columns: int
    lamps: int
    n_moving: int
    farthest: float  # m
    texture_size: float  # m, longest wave of the texture
    texture_seed: int
    seabed: Array
    solids: Array
    depth: bool
    labels: bool
    normals: bool

    @property
    def n_in(self) -> int:
        """Return the number of arguments."""
        return CAMERA_HEAD + CAMERA_LAMP * self.lamps + MOVING * self.n_moving

    @property
    def pixels(self) -> int:
        """Return the number of pixels."""
        return self.rows * self.columns

    @property
    def n_out(self) -> int:
        """Return the number of values."""
        return (3 + self.depth + self.labels + 3 * self.normals) * self.pixels + 3

    def __call__(self, x: Array) -> Array:
        """Return the values (n_out,)."""
        light, depth, label, normal = self.radiance(x)
        levels = self.levels(x, light)
        summary = np.array([levels.mean(), (levels >= 255.0).mean(), np.count_nonzero(label)])
        planes = [levels.ravel(), summary]
        planes += [depth.ravel()] if self.depth else []
        planes += [label.ravel()] if self.labels else []
        planes += [normal.ravel()] if self.normals else []
        return np.concatenate(planes)

    def directions(self, x: Array) -> Array:
        """Return the unit vectors (rows, columns, 3) of the pixels before the lens, camera axes."""
        f, k1, k2 = x[12:15]
        u = (np.arange(self.columns) + 0.5 - self.columns / 2) / f
        v = (np.arange(self.rows) + 0.5 - self.rows / 2) / f
        plane = np.stack(np.meshgrid(u, v), axis=-1)
        r = np.hypot(plane[..., 0], plane[..., 1])
        low, high = np.zeros_like(r), 4.0 * r
        for _ in range(80):  # by bisection: the distortion rises with the radius
            middle = 0.5 * (low + high)
            over = middle * (1.0 + k1 * middle**2 + k2 * middle**4) > r
            low, high = np.where(over, low, middle), np.where(over, middle, high)
        scale = np.divide(low, r, out=np.ones_like(r), where=r > 0.0)
        rays = np.concatenate([plane * scale[..., None], np.ones((*r.shape, 1))], axis=-1)
        return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))

    def radiance(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return radiance (rows, columns, 3), depths and labels (rows, columns), and normals."""
        index, port, row_time = x[41:44]
        light = np.zeros((self.rows, self.columns, 3))
        depth, label = np.zeros(light.shape[:2]), np.zeros(light.shape[:2])
        normal = np.zeros_like(light)
        for i, row in enumerate(self.directions_of(x)):
            dt = (i - (self.rows - 1)) * row_time
            view = _View(self, x, dt)
            for j, a in enumerate(row):
                o = view.o + port * view.R @ (a / a[2])
                if not o[2] >= 0.0:
                    continue
                o[2] = max(o[2], NEAR)
                across = a[:2] / index
                ray = np.array([*across, np.sqrt(1.0 - across @ across)])
                light[i, j], kind, z, n = view.up(o, view.R @ ray)
                if kind == 1 or kind >= 4:
                    depth[i, j], label[i, j] = port + z * ray[2], 1 if kind == 1 else kind - 2
                    normal[i, j] = view.R.T @ n
        return light, depth, label, normal

    def levels(self, x: Array, light: Array) -> Array:
        """Return the grey levels of radiances (rows, columns, 3)."""
        electrons = light * x[35]
        if x[38] > 0.0:
            draw = _mix(int(np.array(x[39:41], "<f4").view("<u8")[0]))
            flat = electrons.ravel()
            noisy = [
                _electrons(mean, x[36], (draw + k * 0x9E3779B97F4A7C15) % WORD)
                for k, mean in enumerate(flat.tolist())
            ]
            electrons = np.array(noisy).reshape(light.shape)
        return np.asarray(np.clip(np.floor(electrons * x[37] + 0.5), 0.0, 255.0))

    def directions_of(self, x: Array) -> Array:
        """Return `directions`, computed once for each lens."""
        key = tuple(x[12:15])
        if _LAST.get("key") != (self.name, key):
            _LAST.update(key=(self.name, key), rays=self.directions(x))
        return np.asarray(_LAST["rays"])

    def texture(self, p: Array, footprint: float) -> float:
        """Return the texture at p from -1 to 1, without waves that are shorter than a pixel."""
        total, size, weight = 0.0, self.texture_size, 0.5
        for n in range(OCTAVES):
            share = min(1.0, size / footprint - 1.0)
            if share <= 0.0:
                break
            total += weight * share * _noise((self.texture_seed + n) % WORD, p / size)
            size, weight = 0.5 * size, 0.5 * weight
        return total


class _View:
    """What all rays of a row share, which is exposed `dt` after the pose of the arguments."""

    def __init__(self, made: CameraImage, x: Array, dt: float) -> None:
        self.made = made
        self.beta_D, self.beta_B, self.K, self.sun, V, self.b = x[15:33].reshape(6, 3)
        self.focal, self.g, self.contrast = x[12], x[33], x[34]
        end = CAMERA_HEAD + CAMERA_LAMP * made.lamps
        self.solids = moving_solids(x[end:])
        half = 0.5 * dt * x[47:50]
        half = half * (1.0 + half @ half / 3.0)  # tan(a) = a + a³ / 3 …
        skew = np.cross(np.eye(3), half)
        Q = np.linalg.solve(np.eye(3) - skew, np.eye(3) + skew)  # Cayley's rotation
        self.o, self.R = x[:3] + dt * x[44:47], Q @ x[3:12].reshape(3, 3)
        self.lamps = x[CAMERA_HEAD:end].reshape(-1, CAMERA_LAMP).copy()
        for lamp in self.lamps:
            lamp[:3], lamp[3:6] = self.o + Q @ (lamp[:3] - x[:3]), Q @ lamp[3:6]
        self.veil = V * self.sun * np.exp(-self.K * max(self.o[2], 0.0))

    def ray(self, o: Array, d: Array) -> tuple[Array, int, float, Array]:
        """Return the radiance, the kind of surface that a ray meets, the way and the normal."""
        made, light = self.made, np.zeros(3)
        kind, (t, n) = first_hit(made.ground, self.solids, o, d, made.farthest)
        into = float(-n @ d)
        if (kind == 1 or kind >= 4) and not into > 0.0:
            kind = 0
        z = {0: made.farthest, 2: 0.0}.get(kind, t)
        if kind == 1 or kind >= 4:
            p = o + z * d
            E = self.sun * 0.5 * (1.0 - n[2]) * np.exp(-self.K * max(p[2], 0.0))
            for lamp in self.lamps:
                away = p - lamp[:3]
                far = max(float(np.linalg.norm(away)), 0.01)
                cosine = float(away @ lamp[3:6]) / far
                facing = max(0.0, float(-away @ n) / far) * _cone(lamp, cosine)
                E = E + lamp[6:9] * facing / far**2 * np.exp(-self.beta_D * far)
            rho = made.seabed if kind == 1 else made.solids[kind - 4]
            shade = 1.0 + self.contrast * made.texture(p, z / (self.focal * max(into, 0.1)))
            light = rho / np.pi * shade * E * np.exp(-self.beta_D * z)
        if z > 0.0:
            light = light + self.veil * (1.0 - np.exp(-self.beta_B * z))
            for lamp in self.lamps:
                light += self.b * _lamp_veil(lamp, o, d, z, self.beta_D, self.g)
        return light, kind, z, n

    def up(self, o: Array, d: Array) -> tuple[Array, int, float, Array]:
        """Return the same as `ray`, with what the surface of the water shows from below."""
        light, kind, z, n = self.ray(o, d)
        if kind == 3 and d[2] < 0.0:
            mirror = reflected(-d[2])
            sky = WATER_INDEX**2 * (1.0 - mirror) / (np.pi * ENTERS)
            p = np.array([*(o + z * d)[:2], NEAR])
            other = self.ray(p, np.array([*d[:2], -d[2]]))[0]
            light = light + np.exp(-self.beta_D * z) * (sky * self.sun + mirror * other)
        return light, kind, z, n


def reflected(c: float) -> float:
    """Return the share that flat water reflects of a ray from below at the cosine c (Fresnel)."""
    sine = WATER_INDEX**2 * (1.0 - c * c)
    if sine >= 1.0:
        return 1.0
    out = np.sqrt(1.0 - sine)
    across = (WATER_INDEX * c - out) / (WATER_INDEX * c + out)
    within = (c - WATER_INDEX * out) / (c + WATER_INDEX * out)
    return float(0.5 * (across**2 + within**2))


_LAST: dict[str, object] = {}


def camera_image(made: CameraImage) -> Callable[[ca.SX], ca.SX]:
    """Return a `CameraImage` as a function of an SX (n_in,) with values (n_out,); it gets a name.

    Raises ParameterInvalid where the reflectances are not those of the scene.
    """
    n = len(made.ground.names) + made.n_moving
    if made.solids.shape != (n, 3):
        raise ParameterInvalid("camera", f"reflectances {made.solids.shape}", f"({n}, 3)")
    digest = hashlib.sha256(made.ground.name.encode())
    for part in fields(made)[2:]:
        value = getattr(made, part.name)
        digest.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return registered(replace(made, name=f"camera_{digest.hexdigest()[:12]}"))


def _cone(lamp: Array, cosine: float) -> float:
    return float(np.clip((cosine - lamp[10]) / (lamp[9] - lamp[10]), 0.0, 1.0))


def _lamp_veil(lamp: Array, o: Array, d: Array, z: float, beta: Array, g: float) -> Array:
    """Return the light of a lamp that a metre of scattering water sends along a ray."""
    to = lamp[:3] - o
    s0 = to @ d
    h = np.sqrt(max(float(to @ to - s0 * s0), 1e-4))
    low, high = (np.tan(0.5 * np.arctan((s - s0) / h)) for s in (0.0, z))
    total = np.zeros(3)
    for place, weight in POINTS:
        t = 0.5 * (low + high) + 0.5 * (high - low) * place
        tau = np.tan(2.0 * np.arctan(t))
        s, far = s0 + h * tau, h * np.hypot(1.0, tau)
        cosine = -h * tau / far
        phase = (1.0 - g * g) / (4.0 * np.pi * (1.0 + g * g - 2.0 * g * cosine) ** 1.5)
        share = _cone(lamp, (s * d - to) @ lamp[3:6] / far)
        step = weight * 0.5 * (high - low) * 2.0 / (1.0 + t * t) / h
        total = total + step * phase * share * np.exp(-beta * (far + s))
    return np.asarray(total * lamp[6:9])


def _electrons(mean: float, read: float, draw: int) -> float:
    h = _mix(draw)
    w = float(NORMALS[_mix(h) % TABLE])
    if mean >= 32.0:
        return float(mean + np.sqrt(read * read + mean) * w)
    u, n, p = (h >> 12) * 2.0**-52, 0, float(np.exp(-mean))
    total = p
    while u >= total and n < 200:
        n += 1
        p *= mean / n
        total += p
    return n + read * w


def _mix(h: int) -> int:
    for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):
        h = (h ^ (h >> 33)) * factor % WORD
    return h ^ (h >> 33)


def _noise(seed: int, p: Array) -> float:
    cell = np.floor(p).astype(int)
    a = p - cell
    a = a * a * (3.0 - 2.0 * a)
    total = 0.0
    for corner in np.ndindex(2, 2, 2):
        i, j, k = (int(c) + n for c, n in zip(cell, corner, strict=True))
        h = seed + i * 0xD1342543DE82EF95 + j * 0xAF251AF3B0F025B5 + k * 0x9FB21C651E98DF25
        h = ((h % WORD) ^ (h % WORD >> 32)) * 0xFF51AFD7ED558CCD % WORD
        value = ((h ^ (h >> 32)) & 0xFFFFFFFF) * 2.0**-31 - 1.0
        total += value * float(np.prod(np.where(corner, a, 1.0 - a)))
    return total
