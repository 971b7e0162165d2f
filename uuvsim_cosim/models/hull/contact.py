"""Contact of a hull with seabed, obstacles and other vehicles, without gain of energy.

The hull's shape is its declared box, a capsule or a ball. Every contact point i, with depth d_i and
approach speed w_i, requires along its normal n_i the displacement

    e_i = min(d_i, cap) + 10 h w_i

which moves the point out of the solid and compensates its approach over the next ten steps. The
smallest displacement delta that satisfies all points, in the norm of the diagonal mass matrix M,
gives the force

    tau = kappa / h² M delta,    delta = argmin 1/2 delta' M delta,   J_i delta >= e_i.

Without speed, tau is therefore the gradient of kappa / (2 h²) times the squared distance (in the
metric of M) to the nearest free pose. For any shapes and any number of contact points, the second
derivative of this distance is at most kappa / h² M, so no direction is too stiff, for every vehicle
and step. If the force passes through a wrench, it acts two steps late; poses and velocities are
therefore predicted for the middle of that step. With one degree of freedom, this delay, and forces
held over steps, the energy never exceeds its start value for kappa up to 0.14. If a solid appears
at the last moment, a hull rebounds with at most 0.63 of its speed for kappa = 0.03, and 1.16 of it
for 0.05 (tests/models/hull/test_contact.py scans both). Hence kappa = 0.03; a larger value is
refused.

The state `memory` holds a free place of the hull's centre on the way that the hull came. At each
tick, this place follows the hull until a solid is in the way, and then slides along the solid. A
hull that passes the middle of a thin wall before a force acts is therefore pushed back, not
through. In this case, cap is 40 h m/s; without a memory (the hull starts inside a solid), and for
the seabed, it is 7.5 h m/s.

Friction is regularised Coulomb friction. Its basis is the smallest change of velocity that stops
the slip of all points; a step makes 14 % of it (with 4/27 or more, a delay of two steps
overshoots), with forces of at most mu times the normal forces. A hull at rest on a slope below the
friction angle therefore creeps with the speed  F_t h / (0.14 m)  for a force F_t and the effective
mass m at the contact.

All contacts are one intrinsic. Like a network (network.py), it is a CasADi Callback that is called
and never inlined; its name is the hash of scene and hull. CasADi evaluates it by
contact_reference.py; FMUs, native components and kernels use fmus/runtime/worlds/uuv_contact.h.
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
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.parameter_files import Size, split_address, vehicle_size
from uuvsim_cosim.models.declaration.vectors import ETA, INERTIA, NU, TAU
from uuvsim_cosim.models.hull.contact_reference import HEAD, PLACE, Hull, free_place, pressed
from uuvsim_cosim.models.hull.matrices import nominal
from uuvsim_cosim.models.intrinsics.network import registered
from uuvsim_cosim.models.worlds.ground import Ground, scene_named, touched_ground
from uuvsim_cosim.models.worlds.rays import MOVING, declare_others

__all__ = [
    "FRICTION",
    "KAPPA",
    "MU",
    "HullContact",
    "HullPlace",
    "contact",
    "hull_contact",
    "hull_of",
    "hull_place",
]

KAPPA = 0.03  # K h² / m of every direction
LONGEST = 0.1  # s, the longest step that tests/kernels/test_thin_walls.py covers


def contact(
    vehicle: str = "bluerov2_heavy",
    scene: str = "flat",
    step: float | str = 0.01,
    others: int | str = 0,
) -> Model:
    """Declare the contact of a vehicle's hull with a scene and `others` further vehicles.

    `step` [s] is the longest communication step of the hull, the contact and the wrench between
    them: a longer one of the system than the stated one makes springs too stiff.
    """
    h = float(step)
    if not 0 < h <= LONGEST:
        raise ParameterInvalid(
            "contact",
            f"step = {step}",
            (
                f"more than 0 and at most {LONGEST:g} s: at longer steps a hull is pressed "
                f"through an obstacle. Use step={LONGEST:g} or less, "
                "here and as the system's step"
            ),
        )
    size = vehicle_size(split_address(vehicle)[0])
    if size is None:
        raise ParameterInvalid(
            "contact", f"{vehicle} states no size", "`size` in its parameters.yaml"
        )
    ground = touched_ground(scene)
    m = Model("contact", "Contact of a hull with seabed, obstacles and other vehicles")
    eta = m.input("eta", 6, unit=ETA, description="of the hull: N E D [m], phi theta psi [rad]")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    nu = m.input("nu", 6, unit=NU, description="of the hull, in b [m/s, rad/s]")
    kappa = m.parameter(
        "kappa", KAPPA, unit="1", min=0, max=KAPPA, description="K h^2 / m; its bound"
    )
    mu = m.parameter("mu", MU, unit="1", min=0, max=2, description="friction on steel or sand")
    M = m.parameter(
        "M", nominal(vehicle)[0], unit=INERTIA, min=1e-9, description="diagonal of M_RB + M_A"
    )
    moving = declare_others(m, others, moving=True)
    call = hull_contact(scene, hull_of(size), moving.numel() // 10)
    pose = ca.vertcat(eta[:3], ca.vec(R(q).T))
    memory = m.discrete("memory", (0, 0, 0, 0), unit=("m", "m", "m", "1"), description=(
        "free place of the hull's middle from which it came; 1: there is one"
    ))  # fmt: skip
    m.update(
        m.clock("sweep", str(step)), memory,
        hull_place(scene, hull_of(size))(ca.vertcat(pose, h, memory)),
    )  # fmt: skip
    over = ca.SX(1.0)
    for axis, first in enumerate(ground.origin):
        if ground.z.shape[axis]:
            last = first + (ground.z.shape[axis] - 1) * ground.spacing
            over = ca.logic_and(ca.logic_and(over, eta[axis] >= first), eta[axis] <= last)
    felt = call(ca.vertcat(pose, nu, M, h, kappa, mu, memory, moving))
    m.output("tau", felt[:6], unit=TAU, description="on the hull, about CO in b")
    m.output("depth", felt[6], unit="m", description="greatest penetration; 0: no contact")
    m.output(
        "touched", felt[7], unit="1", type="Int32",
        description="what it is deepest in: -1 nothing, 0 seabed, i solid i of the scene from 1",
    )  # fmt: skip
    m.output(
        "over_terrain", over, unit="1", type="Boolean",
        description="the hull is above or below the terrain; else there is no bed",
    )  # fmt: skip
    return m


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
    ground = touched_ground(scene)
    material, friction = _friction(scene, ground.name)
    rub = tuple(1.0 if mu is None else mu / MU for mu in ground.friction)
    digest = hashlib.sha256(f"{ground.name} {hull} {friction} {rub} {n_moving} ".encode())
    digest.update(b"" if material is None else material.tobytes())
    name = f"contact_{digest.hexdigest()[:12]}"
    return registered(HullContact(name, ground, hull, material, friction, rub, n_moving))


def hull_place(scene: str, hull: Hull) -> Callable[[ca.SX], ca.SX]:
    """Return `HullPlace` as a function of an SX (17,) with values (4,)."""
    ground = touched_ground(scene)
    digest = hashlib.sha256(f"place {ground.name} {hull}".encode()).hexdigest()
    return registered(HullPlace(f"place_{digest[:12]}", ground, hull))


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
