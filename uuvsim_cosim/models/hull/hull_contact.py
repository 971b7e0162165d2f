"""A hull against a scene as an intrinsic: one call for the generalised force of all contacts.

As a network (network.py) it is a CasADi Callback that is called and never inlined, named by the
hash of scene and hull. CasADi itself evaluates it by contact_reference.py; FMUs, native components
and kernels by fmus/runtime/worlds/uuv_contact.h.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.parameter_files import Size
from uuvsim_cosim.models.hull.contact_reference import HEAD, PLACE, Hull, free_place, pressed
from uuvsim_cosim.models.intrinsics.network import NETWORKS, callback, called
from uuvsim_cosim.models.worlds.ground import Ground, scene_named, touched_ground
from uuvsim_cosim.models.worlds.rays import MOVERS, MOVING

__all__ = ["FRICTION", "MU", "HullContact", "HullPlace", "hull_contact", "hull_of", "hull_place"]

Array = NDArray[np.float64]
MU = 0.30  # of steel on clean sand; NAVFAC DM-7.02 (1986), chapter 3, table 1, steel sheet piles
# tan(delta) of steel on a seabed of this nature, same table: clean gravel and rock fill 0.40,
# clean sand 0.30, nonplastic silt 0.20. Assumption: rock, coral, shells as gravel, mud as silt.
FRICTION = {
    **dict.fromkeys(("mud", "clay", "silt"), 0.20),
    "sand": 0.30,
    **dict.fromkeys(("stone", "gravel", "pebbles", "cobbles", "rock", "lava", "coral"), 0.40),
    **dict.fromkeys(("shells", "boulder"), 0.40),
}
STEP = 1e-6  # of the central difference: uuv_contact_forward


@dataclass(frozen=True, eq=False)
class HullContact:
    """The generalised force (6) on a hull, the greatest depth, and what is touched there.

    In: place of CO (3), rotation b to n row by row (9), nu (6), diagonal mass (6), step, kappa, mu,
    the remembered place (3) and whether there is one, the moving (10 each). Values: uuv_contact.
    """

    name: str
    ground: Ground
    hull: Hull
    material: NDArray[np.uint8] | None  # of each node of the terrain
    friction: tuple[float, ...]  # of each material, beside that of mu
    rub: tuple[float, ...]  # of each solid, likewise
    n_moving: int
    n_out: int = 8

    @property
    def n_in(self) -> int:
        """Return the number of arguments."""
        return HEAD + MOVING * self.n_moving

    def __call__(self, x: Array) -> Array:
        """Return the values (8,)."""
        return pressed(self.ground, self.hull, self.bed_friction, np.array(self.rub), x)

    def jacobian(self, x: Array) -> Array:
        """Return d values / d x by central differences; of the last value 0."""
        return _slopes(self, x, self.n_out)

    def bed_friction(self, north: float, east: float) -> float:
        """Return the friction of the seabed there, as a share of mu."""
        if self.material is None:
            return 1.0
        at = np.array([north, east]) - self.ground.origin
        i, j = np.clip((at / self.ground.spacing + 0.5).astype(int), 0, self.material.shape)
        rows, columns = self.material.shape
        return float(self.friction[self.material[min(i, rows - 1), min(j, columns - 1)]])


@dataclass(frozen=True, eq=False)
class HullPlace:
    """The free place (3) of a hull's middle that contact remembers, and 1 if it counts.

    In: place of CO (3), rotation b to n row by row (9), step, what was remembered (4).
    """

    name: str
    ground: Ground
    hull: Hull
    n_in: int = PLACE
    n_out: int = 4

    def __call__(self, x: Array) -> Array:
        """Return the values (4,)."""
        return free_place(self.ground, self.hull, x)

    def jacobian(self, x: Array) -> Array:
        """Return d values / d x by central differences; of the last value 0."""
        return _slopes(self, x, self.n_out)


def _slopes(of: Callable[[Array], Array], x: Array, n: int) -> Array:
    J = np.zeros((n, len(x)))
    for i in range(len(x)):
        by = np.zeros(len(x))
        by[i] = STEP
        J[:-1, i] = (of(x + by) - of(x - by))[:-1] / (2.0 * STEP)
    return J


def hull_of(size: Size) -> Hull:
    """Return the shape that stands for a hull: its box, or a capsule along x, or a ball.

    A torpedo or ellipsoid counts as the capsule of its length and of its smaller breadth or height.
    """
    if size.shape == "box":
        return Hull(size.at, (size.length / 2, size.breadth / 2, size.height / 2), 3, 0.0)
    radius = min(size.length, size.breadth, size.height) / 2
    reach = size.length / 2 - radius
    return Hull(size.at, (reach, 0.0, 0.0), 1 if reach > 0 else 0, radius)


def hull_contact(scene: str, hull: Hull, n_moving: int) -> Callable[[ca.SX], ca.SX]:
    """Return `HullContact` as a function of an SX (n_in,) with values (8,)."""
    if not 0 <= n_moving <= MOVERS:
        raise ParameterInvalid("others", n_moving, f"0 to {MOVERS}")
    ground = touched_ground(scene)
    material, friction = _friction(scene, ground.name)
    rub = tuple(1.0 if mu is None else mu / MU for mu in ground.friction)
    digest = hashlib.sha256(f"{ground.name} {hull} {friction} {rub} {n_moving} ".encode())
    digest.update(b"" if material is None else material.tobytes())
    name = f"contact_{digest.hexdigest()[:12]}"
    return _called(HullContact(name, ground, hull, material, friction, rub, n_moving))


def hull_place(scene: str, hull: Hull) -> Callable[[ca.SX], ca.SX]:
    """Return `HullPlace` as a function of an SX (17,) with values (4,)."""
    ground = touched_ground(scene)
    digest = hashlib.sha256(f"place {ground.name} {hull}".encode()).hexdigest()
    return _called(HullPlace(f"place_{digest[:12]}", ground, hull))


def _called(made: HullContact | HullPlace) -> Callable[[ca.SX], ca.SX]:
    if made.name not in NETWORKS:
        NETWORKS[made.name] = made
        shape = (made.n_out, made.n_in)
        gradient = callback(f"{made.name}_jacobian", made.jacobian, made.n_in, shape, None)
        callback(made.name, made, made.n_in, (made.n_out, 1), gradient)
    return called(made.name)


@lru_cache(maxsize=8)
def _friction(scene: str, contents: str) -> tuple[NDArray[np.uint8] | None, tuple[float, ...]]:
    """Return the materials of a terrain's nodes, where it states any, and the friction of each."""
    terrain = scene_named(scene).terrain
    if terrain is None or terrain.material is None:
        return None, ()
    shares = tuple(FRICTION.get(name, MU) / MU for name in terrain.materials)
    material = np.ascontiguousarray(terrain.material, np.uint8)
    if int(material.max()) >= len(shares):
        shares += (1.0,) * (int(material.max()) + 1 - len(shares))
    return material, shares
