"""A hull that touches seabed, obstacles or other vehicles is pushed back, and gains nothing.

The hull counts as balls: the corners of a box, with radius 0, or three balls along a torpedo. Ball
i at r_i that is d deep in a solid, by the distance to the nearest point of its surface with normal
n, feels f = max(0, K d + C dd/dt) along n (fmus/runtime/uuv_touch.h). There is no friction.

Stability: springs add at most K sum J_i^T J_i with J_i = [I, -S(r_i)] to the equations of motion,
so that with the diagonal mass matrix M of the vehicle and the step h

    kappa = K h² lambda_max(M^-1 sum J_i^T J_i),    C = 6 h K.

A force arrives two steps late where it goes through a wrench. With one degree of freedom, that
delay and forces held over steps, kinetic, gravity's and spring energy together never exceed what
they were, in any phase of the step, for kappa up to 0.22 (tests/models/test_contact.py scans it).
In a valley or at an edge the nearest point jumps, and a force begins at full speed: then 3 C h / m
must stay below 1. Hence kappa = 0.05, and a greater K is refused. On rough beds kinetic and
gravity's energy never exceeded the start; the spring's, which the first two steps of a contact
cannot yet answer, can do so for a moment.
"""

from __future__ import annotations

from math import floor, log10
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.controller import nominal
from uuvsim_cosim.models.ground import ground_named
from uuvsim_cosim.models.kinematics import R
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.models.others import declare_others
from uuvsim_cosim.models.parameters import Size, split_address, vehicle_size
from uuvsim_cosim.models.rays import touch
from uuvsim_cosim.models.vectors import ETA, NU, TAU

__all__ = ["KAPPA", "LEAD", "balls_of", "contact", "stiffness"]

KAPPA = 0.05  # K h² / m of the stiffest direction
LEAD = 6.0  # C / (K h)
LATE = 2.5  # steps from the hull's pose to the middle of the step in which its force acts
Array = NDArray[np.float64]


def contact(
    vehicle: str = "bluerov2_heavy",
    scene: str = "flat",
    step: float | str = 0.01,
    others: int | str = 0,
) -> Model:
    """Declare the contact of a vehicle's hull with a scene and `others` further vehicles.

    `step` [s] is the longest communication step of the hull, the contact and the wrench between
    them: a longer one of the system than was said makes springs too stiff.
    """
    h = float(step)
    if not 0 < h < 1:
        raise ParameterInvalid(f"contact: step = {step}; expected more than 0 and less than 1 s")
    size = vehicle_size(split_address(vehicle)[0])
    if size is None:
        raise ParameterInvalid(
            f"contact: {vehicle} states no size; expected `size` in its parameters.yaml"
        )
    r, radius = balls_of(size)
    most = stiffness(vehicle, r, h)
    ground = ground_named(scene)
    m = Model("contact", "Contact of a hull with seabed, obstacles and other vehicles")
    eta = m.input("eta", 6, unit=ETA, description="of the hull: N E D [m], phi theta psi [rad]")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    nu = m.input("nu", 6, unit=NU, description="of the hull, in b [m/s, rad/s]")
    K = m.parameter(
        "K", most, unit="N/m", min=0, max=most, description="stiffness of each ball; its bound"
    )
    C = m.derived("C", LEAD * h * K)
    moving = declare_others(m, others, moving=True)
    call = touch(scene, moving.numel() // 10)
    Rnb = R(q)
    total, deepest = ca.SX.zeros(6), ca.SX(0)
    for place in r:
        p = eta[:3] + ca.mtimes(Rnb, ca.DM(place))
        v = ca.mtimes(Rnb, nu[:3] + ca.cross(nu[3:], ca.DM(place)))
        felt = call(ca.vertcat(p, v, K, C, radius, moving))
        force = ca.mtimes(Rnb.T, felt[:3])
        force -= LATE * h * ca.cross(nu[3:], force)  # in the axes that b will have turned to
        total += ca.vertcat(force, ca.cross(ca.DM(place), force))
        deepest = ca.if_else(felt[3] > deepest, felt[3], deepest)
    m.output("tau", total, unit=TAU, description="on the hull, about CO in b")
    m.output("depth", deepest, unit="m", description="greatest penetration; 0: no contact")
    m.output(
        "over_terrain", _within(ground.z.shape, ground.origin, ground.spacing, eta), unit="1",
        type="Boolean", description="the hull is above or below the terrain; else there is no bed",
    )  # fmt: skip
    return m


def balls_of(size: Size) -> tuple[Array, float]:
    """Give the places (n, 3) from CO in b [m], and the radius [m], of the balls of a hull."""
    if size.shape == "box":
        sides = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
        return sides * (size.length, size.breadth, size.height) + size.at, 0.0
    radius = min(size.length, size.breadth, size.height) / 2
    reach = size.length / 2 - radius
    places = [[x, 0.0, 0.0] for x in ((-reach, 0.0, reach) if reach > 0 else (0.0,))]
    return np.array(places) + size.at, radius


def stiffness(vehicle: str, r: Array, h: float) -> float:
    """Give the greatest stiffness [N/m] of balls at r (n, 3) for a step h [s], two digits of it."""
    mass = np.array(nominal(vehicle)[0])
    J = [np.hstack([np.eye(3), -_cross(place)]) for place in r]
    scaled = [j / np.sqrt(mass) for j in J]
    largest = float(np.linalg.eigvalsh(sum(j.T @ j for j in scaled))[-1])
    K = KAPPA / (h**2 * largest)
    digit = 10.0 ** (floor(log10(K)) - 1)  # the same on every machine
    return float(f"{floor(K / digit + 1e-9) * digit:.6g}")


def _cross(a: Any) -> Array:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _within(shape: tuple[int, ...], origin: tuple[float, float], spacing: float, eta: Any) -> Any:
    inside = [ca.SX(1.0)]
    for axis in (0, 1):
        if shape[axis]:
            far = origin[axis] + (shape[axis] - 1) * spacing
            inside += [eta[axis] >= origin[axis], eta[axis] <= far]
    every = inside[0]
    for one in inside[1:]:
        every = ca.logic_and(every, one)
    return every
