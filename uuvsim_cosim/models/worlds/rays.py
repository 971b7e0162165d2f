"""Rays and frames of rays as intrinsics: one call in the equations for them all.

As a network (network.py) each is a CasADi Callback that is called and never inlined, named by the
hash of its scene and shape; an emitter finds it in `NETWORKS`. CasADi itself evaluates it by
ray_reference.py, FMUs, native components and kernels by fmus/runtime/worlds/uuv_rays.h.

Other vehicles, as a component sees them, are capsules along their x axes that move by inputs.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.vectors import ETA, NU
from uuvsim_cosim.models.intrinsics.network import registered
from uuvsim_cosim.models.worlds.ground import Ground, ground_named
from uuvsim_cosim.models.worlds.ray_reference import first_hit

__all__ = [
    "FRAME_HEAD",
    "MOVERS",
    "MOVING",
    "Frame",
    "Rays",
    "declare_others",
    "frame",
    "moving_solids",
    "rays",
]

Array = NDArray[np.float64]
MOVING = 10  # numbers of a moving capsule: UUV_MOVING
MOVERS = 64  # at most: UUV_MOVERS
FRAME_HEAD = 19  # UUV_FRAME_HEAD


@dataclass(frozen=True, eq=False)
class Rays:
    """Ranges and cosines of incidence along n directions from one place.

    In: origin (3), farthest range, the moving (10 each), directions (3 each). Out: n ranges, -1
    where no solid is met from outside, and n cosines.
    """

    name: str
    ground: Ground
    n: int
    n_moving: int

    @property
    def n_in(self) -> int:
        """Return the number of arguments."""
        return 4 + MOVING * self.n_moving + 3 * self.n

    @property
    def n_out(self) -> int:
        """Return the number of values."""
        return 2 * self.n

    def __call__(self, x: Array) -> Array:
        """Return the values (n_out,)."""
        return self._each(x)[0]

    def jacobian(self, x: Array) -> Array:
        """Return d values / d x; the moving count as still."""
        return self._each(x)[1]

    def _each(self, x: Array) -> tuple[Array, Array]:
        solids = moving_solids(x[4 : 4 + MOVING * self.n_moving])
        first = 4 + MOVING * self.n_moving
        y, J = np.zeros(self.n_out), np.zeros((self.n_out, self.n_in))
        for i, d in enumerate(x[first:].reshape(-1, 3)):
            y[i], hit, n, into, t = -1.0, *_met(self.ground, solids, x[:3], d, x[3])
            if hit:
                size, own = np.linalg.norm(d), slice(first + 3 * i, first + 3 * i + 3)
                y[i], y[self.n + i] = t, into / size
                J[i, :3], J[i, own] = n / into, t * n / into
                J[self.n + i, own] = -(n + into * d / size**2) / size
        return y, J


@dataclass(frozen=True, eq=False)
class Frame:
    """Readings, with their noise, along the rays of an instrument; see uuv_frame_seen."""

    name: str
    ground: Ground
    directions: Array  # (n, 3) unit vectors in sensor axes
    depth: bool
    n_moving: int

    @property
    def n_in(self) -> int:
        """Return the number of arguments."""
        return FRAME_HEAD + MOVING * self.n_moving + len(self.directions)

    @property
    def n_out(self) -> int:
        """Return the number of values."""
        return len(self.directions) + 1

    def __call__(self, x: Array) -> Array:
        """Return the readings, and how many there are."""
        end = FRAME_HEAD + MOVING * self.n_moving
        solids, R = moving_solids(x[FRAME_HEAD:end]), x[3:12].reshape(3, 3)
        sigma, relative, bias, low, high, least, lost = x[12:FRAME_HEAD]
        y = np.zeros(self.n_out)
        for i, (a, w) in enumerate(zip(self.directions, x[end:], strict=True)):
            hit, _, into, t = _met(self.ground, solids, x[:3], R @ a, high)
            digits = (w + 16.0) * 1024.0 % 1.0
            if not hit or into < least or t < low or digits < lost:
                continue
            reading = t + bias + np.hypot(sigma, relative * t) * w
            if reading > 0.0:
                y[i] = reading * (a[2] if self.depth else 1.0)
                y[-1] += 1.0
        return y


def rays(scene: str, n: int, n_moving: int) -> Callable[[ca.SX], ca.SX]:
    """Return `Rays` as a function of an SX (n_in,) with values (n_out,)."""
    ground = ground_named(scene)
    return registered(Rays(_name("rays", ground, n, n_moving), ground, n, n_moving))


def frame(scene: str, directions: Array, depth: bool, n_moving: int) -> Callable[[ca.SX], ca.SX]:
    """Return a `Frame` as a function of an SX (n_in,) with values (n_out,); without derivatives."""
    ground, d = ground_named(scene), np.ascontiguousarray(directions, float)
    digest = hashlib.sha256(d.astype("<f8").tobytes()).hexdigest()
    name = _name("frame", ground, depth, n_moving, digest)
    return registered(Frame(name, ground, d, depth, n_moving))


def _name(kind: str, ground: Ground, *shape: object) -> str:
    digest = hashlib.sha256(f"{ground.name} {shape}".encode()).hexdigest()[:12]
    return f"{kind}_{digest}"


def moving_solids(x: Array) -> Array:
    """Return the moving as rows of solids; those of no radius are left out."""
    rows = [
        [2.0, *m[:7], 0.0, float(np.linalg.norm(m[3:6])) + m[6]]
        for m in x.reshape(-1, MOVING)
        if m[6] > 0.0
    ]
    return np.array(rows).reshape(-1, 10)


def _met(
    g: Ground, solids: Array, o: Array, d: Array, far: float
) -> tuple[int, Array, float, float]:
    """Return the hit (0: no echo), its normal, the cosine times the length, and the range."""
    hit, (t, n) = first_hit(g, solids, o, d, far)
    into = float(-n @ d)
    echo = (hit == 1 or hit >= 4) and into > 0.0
    return (hit if echo else 0), n, into, t


def declare_others(m: Model, others: int | str, *, moving: bool = False) -> ca.SX:
    """Declare the others' poses and sizes; return the numbers of uuv_moving_, 10 for each.

    With `moving` there are inputs of their velocities too.
    """
    n = int(others)
    if not 0 <= n <= MOVERS:
        raise ParameterInvalid(m.name, f"others = {others}", f"0 to {MOVERS}")
    if not n:
        return ca.SX(0, 1)
    poses = [
        m.input(f"other_eta_{i}", 6, unit=ETA, description=f"of vehicle {i}: its hull's eta")
        for i in range(1, n + 1)
    ]
    rates = [
        m.input(f"other_nu_{i}", 6, unit=NU, description=f"of vehicle {i}: its hull's nu")
        if moving
        else ca.SX.zeros(6)
        for i in range(1, n + 1)
    ]
    size = m.parameter(
        "other_size",
        np.zeros((n, 2)),
        unit="m",
        min=0,
        description="of each: radius, and half the length between the ends; radius 0: none",
    )
    each = []
    for i, (eta, nu) in enumerate(zip(poses, rates, strict=True)):
        Rnb = R_zyx(eta[3], eta[4], eta[5])
        half = size[i, 1] * Rnb[:, 0]
        each.append(ca.vertcat(eta[:3], half, size[i, 0], ca.mtimes(Rnb, nu[:3])))
    return ca.vertcat(*each)
