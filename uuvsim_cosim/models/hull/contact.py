"""Contact of a hull with seabed, obstacles and other vehicles, without gain of energy.

The hull is its declared box, a capsule or a ball. Every contact point i asks, along its normal
n_i, for the displacement

    e_i = min(d_i, cap) + 10 h w_i

of depth d_i and approach speed w_i: out of the solid, and against what the next ten steps bring.
The least displacement delta that serves all, measured by the diagonal mass matrix M, gives

    tau = kappa / h² M delta,    delta = argmin 1/2 delta' M delta,   J_i delta >= e_i.

So without speed tau is the gradient of kappa / (2 h²) times the squared distance (in the metric
of M) to the nearest free pose. Whatever the shapes and however many points touch, the second
derivative of such a distance is at most kappa / h² M: no direction is too stiff, for every vehicle
and step. A force arrives two steps late where it goes through a wrench: poses and velocities are
predicted for the middle of that step. With one degree of freedom, that delay and forces held over
steps, energy never exceeds the start for kappa up to 0.14. Where a solid appears at the last
moment, a hull leaves with at most 0.63 of its speed for kappa = 0.03 and 1.16 of it for 0.05
(tests/models/hull/test_contact.py scans both). Hence kappa = 0.03, and more is refused.

The state `memory` holds a free place of the hull's middle, from which the hull came: at each tick
it follows the hull as far as no solid is in the way, and slides along what is. A hull that passes
the middle of a thin wall before a force acts is therefore pushed back, not through. Then cap is
40 h m/s; without a memory (the hull began inside something), and for the seabed, 7.5 h m/s.

Friction is Coulomb's, regularised: the least change of velocity that stops the slip of all points,
of which a step makes 14 % (less than 4/27, from which on a delay of two steps overshoots), by
forces of at most mu times the normal ones. A hull at rest on a slope below the friction angle
therefore creeps, by  F_t h / (0.14 m)  for a force F_t and the effective mass m at the contact.

The solver is in fmus/runtime/worlds/uuv_contact.h.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.parameter_files import split_address, vehicle_size
from uuvsim_cosim.models.declaration.vectors import ETA, INERTIA, NU, TAU
from uuvsim_cosim.models.hull.hull_contact import MU, hull_contact, hull_of, hull_place
from uuvsim_cosim.models.hull.matrices import nominal
from uuvsim_cosim.models.worlds.ground import touched_ground
from uuvsim_cosim.models.worlds.others import declare_others

__all__ = ["KAPPA", "contact"]

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
                f"more than 0 and at most {LONGEST:g} s: at longer steps a hull is "
                f"pressed through what it touches. Use step={LONGEST:g} or less, "
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
    felt = call(ca.vertcat(pose, nu, M, h, kappa, mu, memory, moving))
    m.output("tau", felt[:6], unit=TAU, description="on the hull, about CO in b")
    m.output("depth", felt[6], unit="m", description="greatest penetration; 0: no contact")
    m.output(
        "touched", felt[7], unit="1", type="Int32",
        description="what it is deepest in: -1 nothing, 0 seabed, i solid i of the scene from 1",
    )  # fmt: skip
    m.output(
        "over_terrain", _within(ground.z.shape, ground.origin, ground.spacing, eta), unit="1",
        type="Boolean", description="the hull is above or below the terrain; else there is no bed",
    )  # fmt: skip
    return m


def _within(
    shape: tuple[int, ...], origin: tuple[float, float], spacing: float, eta: ca.SX
) -> ca.SX:
    inside = [ca.SX(1.0)]
    for axis in (0, 1):
        if shape[axis]:
            far = origin[axis] + (shape[axis] - 1) * spacing
            inside += [eta[axis] >= origin[axis], eta[axis] <= far]
    every = inside[0]
    for one in inside[1:]:
        every = ca.logic_and(every, one)
    return every
