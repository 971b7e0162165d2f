"""Image of a sonar as an intrinsic: one call in the equations for all its beams and bins.

FMUs, native components and kernels evaluate it by fmus/runtime/worlds/uuv_sonar.h, which states the
model. CasADi itself evaluates it in numpy, with rays by brute force (ray_reference.py).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, fields

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.intrinsics.network import registered
from uuvsim_cosim.models.worlds.ground import Ground
from uuvsim_cosim.models.worlds.rays import MOVING, moving_solids
from uuvsim_cosim.models.worlds.sonar_geometry import AMPLITUDES, TABLE, TURNS, SonarGeometry
from uuvsim_cosim.models.worlds.sonar_path import STRAIGHT, SonarPaths, Way

__all__ = [
    "ANGLES",
    "SONAR_HEAD",
    "SonarImage",
    "Surfaces",
    "check_surfaces",
    "over_cosine",
    "sonar_image",
]

Array = NDArray[np.float64]
Words = NDArray[np.uint64]
ANGLES = 256  # UUV_SONAR_ANGLES
SONAR_HEAD = 22  # UUV_SONAR_HEAD
SMALLEST = 2.0**-14  # m, of a scatterer's cell
# Parts of a cell by which the grid is shifted: a bottom at a round depth is on no border of cells.
UNEVEN = np.array([0.3819660112501052, 0.2360679774997897, 0.4142135623730951])
_Complex = complex  # a field of a class below has the same name


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Backscatter of the scene: sigma (materials, angles) at grazing angles 0 to pi / 2.

    sigma is the cross section per area and solid angle. `seabed` holds the material of each node of
    the terrain, or nothing: material 0. `solids` that of each solid, mesh and mover, in this order.
    """

    sigma: Array
    seabed: NDArray[np.uint8]
    solids: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class SonarImage:
    """Magnitudes [beam][bin], range and echo of each beam, mean, peak; parts, labels."""

    name: str
    ground: Ground
    geometry: SonarGeometry
    surfaces: Surfaces
    tvg: int  # gain of 10 tvg log10 r
    n_moving: int
    complex: bool
    labels: bool
    paths: SonarPaths = STRAIGHT

    @property
    def n_in(self) -> int:
        """Return the number of arguments."""
        return SONAR_HEAD + MOVING * self.n_moving

    @property
    def pixels(self) -> int:
        """Return the number of beams times that of bins."""
        return len(self.geometry.bearings) * self.geometry.bins

    @property
    def n_out(self) -> int:
        """Return the number of values."""
        planes = 1 + 2 * self.complex + self.labels
        return planes * self.pixels + 2 * len(self.geometry.bearings) + 2

    def __call__(self, x: Array) -> Array:
        """Return the values (n_out,)."""
        g = self.geometry
        beams = len(g.bearings)
        pressure, labels = self._echoes(x)
        h = _mix(_key(x) + np.arange(self.pixels, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15))
        noise = x[15] * AMPLITUDES[h & np.uint64(TABLE - 1)] * _unit(h >> np.uint64(12))
        pressure = pressure + noise.reshape(beams, g.bins)
        gain = x[16] * x[17] ** np.arange(g.bins) * g.ranges ** (self.tvg / 2)
        image = np.abs(pressure) * gain
        heard = np.where(np.abs(pressure) > x[15] * x[18], image, 0.0)
        ranges = np.where(heard.max(axis=1) > 0.0, g.ranges[heard.argmax(axis=1)], 0.0)
        planes = [image.ravel(), ranges, heard.max(axis=1), [image.mean(), image.max()]]
        if self.complex:
            planes += [(pressure * gain).real.ravel(), (pressure * gain).imag.ravel()]
        if self.labels:
            planes.append(labels.ravel())
        return np.concatenate(planes)

    def _echoes(self, x: Array) -> tuple[NDArray[np.complex128], Array]:
        g = self.geometry
        R, solids = x[3:12].reshape(3, 3), moving_solids(x[SONAR_HEAD:])
        n_cells = g.fine * (g.bins + 2 * g.pad)
        cells = np.zeros((len(g.u), n_cells), complex)
        loss = x[13] * x[14] ** np.arange(n_cells)
        loud = np.zeros((len(g.bearings), g.bins, 2))
        far = g.first + (g.bins + g.pad) * g.step
        strengths = over_cosine(self.surfaces.sigma)
        columns_ = zip(g.u, g.du, strict=True) if x[2] >= 0.0 else ()  # not above the water
        for j, (u, du) in enumerate(columns_):
            side = np.sqrt(1.0 - u * u)
            for t, power in zip(g.theta, g.gain, strict=True):
                d = R @ [side * np.cos(t), u, side * np.sin(t)]
                across = R @ [-side * np.sin(t), 0.0, side * np.cos(t)]
                way, turned = Way(x[:3], d, across), 1.0 + 0.0j
                for _leg in range(2):
                    hit = way.follow(
                        self.ground, solids, self.paths.level, self.paths.chord, far, x[21]
                    )
                    if (hit == 1 or hit >= 4) and way.normal @ way.d < 0.0:
                        row = strengths[self._material(hit, way.at)]
                        k, a, echo = self._scattered(x, way, row, du, power, loss)
                        np.add.at(cells[j], k, turned * echo)
                        if self.labels:
                            label = 1 if hit == 1 else hit - 2
                            self._label(loud, j, k, abs(turned) ** 2 * a**2, label)
                    turned = self._reflected(way, hit)
                    if not turned:
                        break
                    way.bounce()
        padded = (cells * loss).reshape(len(g.u), -1, g.fine)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * g.pad + 1, axis=1)
        columns = np.einsum("jbft,tf->jb", windows, g.pulse.astype(float))
        return g.weight.T.astype(float) @ columns, loud[..., 1]

    def _scattered(
        self, x: Array, way: Way, strength: Array, du: float, power: float, loss: Array
    ) -> tuple[NDArray[np.int_], Array, NDArray[np.complex128]]:
        """Return cells, amplitudes and pressures of the scatterers that a way met."""
        g = self.geometry
        edge, size = g.first - g.pad * g.step, 2.0 * g.step / g.fine
        c, slope, r0 = -way.normal @ way.d, -way.normal @ way.across, way.spread
        half = 0.5 * g.d_theta * abs(slope)
        down = min(half, 0.75 * c)
        near, most = r0 * c / (c + half), r0 * c / (c - down)
        m = 1 + int((most - near) / size)
        edges = np.linspace(near, most, m + 1)
        r = 0.5 * (edges[1:] + edges[:-1]) if m > 1 else np.array([r0])
        share = -np.diff(r0 * c / edges) / (half + down) if m > 1 else np.ones(1)
        cosine = np.minimum(r0 * c / r if m > 1 else c, 1.0)
        mean = np.interp(cosine * ANGLES, np.arange(ANGLES + 1), strength)
        angle = (cosine - c) / slope if slope != 0.0 and m > 1 else 0.0 * r
        p = way.at - r0 * way.d + r[:, None] * (way.d + angle[:, None] * way.across)
        tall = 0.5 * (most - near) / m if m > 1 else r0 * g.d_theta
        h = _cell(p, max(min(r0 * du, float(tall)), SMALLEST))
        a = np.sqrt(share * power * g.d_theta * du * mean) / r
        per = x[21] / way.c if len(self.paths.level) else 1.0
        shown = way.range + per * (r - r0)
        k = np.floor((shown - edge) * g.fine / g.step).astype(int)
        kept = (k >= 0) & (k < len(loss))
        k, a, h, shown = k[kept], a[kept], h[kept], shown[kept]
        turns = (x[12] * TABLE * shown).astype(np.int64).astype(np.uint64)
        echo = a * AMPLITUDES[h & np.uint64(TABLE - 1)] * _unit(turns + (h >> np.uint64(12)))
        if len(self.paths.level):  # the water absorbs along the path
            path = ((way.length + r[kept] - r0 - edge) * g.fine / g.step).astype(int)
            echo *= loss[np.clip(path, 0, len(loss) - 1)] / loss[k]
        return k, a, echo

    def _label(self, loud: Array, j: int, k: NDArray[np.int_], power: Array, label: int) -> None:
        g = self.geometry
        for at, power_ in zip(k // g.fine - g.pad, power, strict=True):
            for b in range(*g.nearest[j]):
                if 0 <= at < g.bins and power_ > loud[b, at, 0]:
                    loud[b, at] = power_, label

    def _reflected(self, way: Way, hit: int) -> _Complex:
        """Return the squared reflection coefficient of what a way met; 0: there is no bounce."""
        p = self.paths
        c = -way.normal @ way.d
        if hit == 3 and len(p.surface):
            row = p.surface
        elif hit == 1 and len(p.bottom):
            row = p.bottom[self._material(hit, way.at)]
        else:
            return 0.0
        parts = [np.interp(c * ANGLES, np.arange(ANGLES + 1), row[:, k]) for k in (0, 1)]
        return complex(*parts) if c > 0.0 else 0.0

    def _material(self, hit: int, p: Array) -> int:
        s = self.surfaces
        if hit >= 4:
            return int(s.solids[hit - 4])
        if not s.seabed.size:
            return 0
        at = np.floor((p[:2] - self.ground.origin) / self.ground.spacing + 0.5).astype(int)
        i, j = np.clip(at, 0, np.array(s.seabed.shape) - 1)
        return int(s.seabed[i, j])


def over_cosine(sigma: Array) -> Array:
    """Return sigma / c at ANGLES + 1 equal steps of the cosine of incidence c, from 0 to 1.

    `sigma` has rows over equal steps of the grazing angle from 0 to pi / 2.
    """
    c = np.arange(1, ANGLES + 1) / ANGLES
    at = np.arcsin(c) / (np.pi / 2) * (sigma.shape[1] - 1)
    known = np.arange(sigma.shape[1])
    rows = np.array([np.interp(at, known, row) / c for row in sigma])
    return np.concatenate([np.zeros((len(rows), 1)), rows], axis=1)


def check_surfaces(ground: Ground, surfaces: Surfaces, n_moving: int) -> None:
    """Raise ParameterInvalid where the surfaces are not those of the scene and of what moves."""
    solids = len(ground.names) + n_moving
    if len(surfaces.solids) != solids or (
        surfaces.seabed.size and surfaces.seabed.shape != ground.z.shape
    ):
        raise ParameterInvalid(
            "sonar",
            f"materials of {len(surfaces.solids)} solids and a terrain {surfaces.seabed.shape}",
            f"{solids} and {ground.z.shape}",
        )
    used = np.concatenate([surfaces.seabed.ravel(), surfaces.solids])
    if used.size and int(used.max()) >= len(surfaces.sigma):
        raise ParameterInvalid("sonar", f"material {used.max()}", f"below {len(surfaces.sigma)}")


def sonar_image(
    ground: Ground,
    geometry: SonarGeometry,
    surfaces: Surfaces,
    *,
    tvg: int,
    n_moving: int = 0,
    complex: bool = False,
    labels: bool = False,
    paths: SonarPaths = STRAIGHT,
) -> Callable[[ca.SX], ca.SX]:
    """Return a `SonarImage` as a function of an SX (n_in,) with values (n_out,).

    Raises ParameterInvalid where the surfaces are not those of the scene.
    """
    check_surfaces(ground, surfaces, n_moving)
    shape = (tvg, n_moving, complex, labels)
    digest = hashlib.sha256(f"{ground.name} {shape}".encode())
    for each in (geometry, surfaces, paths):
        for part in fields(each):
            value = getattr(each, part.name)
            digest.update(
                value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
            )
    name = f"sonar_{digest.hexdigest()[:12]}"
    return registered(SonarImage(name, ground, geometry, surfaces, *shape, paths))


def _key(x: Array) -> np.uint64:
    draws = np.array(x[19:21], "<f4").view("<u8")
    return np.uint64(_mix(draws.astype(np.uint64))[0])


def _mix(h: Words) -> Words:
    for factor in (0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53):
        h = (h ^ (h >> np.uint64(33))) * np.uint64(factor)
    return np.asarray(h ^ (h >> np.uint64(33)))


def _cell(p: Array, size: float) -> Words:
    """Return the bits of the cells of points (n, 3), of the power of 2 at or below `size`."""
    exponent = int(np.floor(np.log2(size)))
    i = np.floor(p * 2.0**-exponent + UNEVEN).astype(np.int64).astype(np.uint64)
    h = np.uint64((exponent + 1023) * 0x9E3779B97F4A7C15 % 2**64) + i[:, 0] * np.uint64(
        0xD1342543DE82EF95
    )
    h = (h ^ (h >> np.uint64(29))) + i[:, 1] * np.uint64(0xAF251AF3B0F025B5)
    h = (h ^ (h >> np.uint64(31))) + i[:, 2] * np.uint64(0x9FB21C651E98DF25)
    return _mix(h)


def _unit(turns: Words) -> NDArray[np.complex128]:
    pair = TURNS[turns & np.uint64(TABLE - 1)].astype(float)
    return np.asarray(pair[:, 0] + 1j * pair[:, 1])
