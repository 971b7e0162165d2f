"""Contact with the walls and floor of a pool: springs and dampers, without gain of energy.

The hull counts as an upright cylinder about CO. Against each wall, the floor and each obstacle,
with d the depth of penetration and h the communication step for which a force is held,

    f = max(0, K d + (B + K h) dd/dt)

is continuous and never pulls. K d + K h dd/dt is the spring force one step later, so that holding f
over a step adds no energy. Stability bounds K, which is kappa m / h² here. There is no friction,
and the force acts through CO, so there is no moment. The water surface needs no contact force,
because a hull loses its buoyancy there.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import norm, smoothstep
from uuvsim_cosim.models.declaration.vectors import NU, TAU
from uuvsim_cosim.models.hull.matrices import nominal

__all__ = ["declare_arena", "pool"]

KAPPA = 0.14  # K h² / m; beyond about 1 a held force rings


def pool(
    vehicle: str = "pool8",
    radius: float | str = 0.149,
    height: float | str = 0.12,
    obstacles: int | str = 0,
    step: float | str = 0.02,
) -> Model:
    """Declare the contact of a vehicle's hull, of this radius and height [m], with a pool.

    `step` [s] is the longest time that a force is held. Obstacles are upright cylinders.
    """
    h = float(step)
    if not h > 0:
        raise ParameterInvalid("pool", f"step = {step}", "more than 0 s")
    mass = nominal(vehicle)[0][0]
    m = Model("pool", "Contact of a hull with walls, floor and obstacles of a pool")
    position = m.input("position", 3, unit="m", description="of the hull's CO in NED")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    nu = m.input("nu", 6, unit=NU, description="of the hull, in b [m/s, rad/s]")
    origin, size, cylinders = declare_arena(m, int(obstacles))
    r = m.parameter("radius", float(radius), unit="m", min=0, description="of the hull")
    half = 0.5 * m.parameter("height", float(height), unit="m", min=0, description="of the hull")
    K = m.parameter(
        "K", KAPPA * mass / h**2, unit="N/m", min=0, max=0.5 * mass / h**2, description="stiffness"
    )
    B = m.parameter(
        "B", KAPPA * mass / h, unit="N.s/m", min=0, max=0.5 * mass / h, description="damping"
    )

    def push(d: ca.SX, d_dot: ca.SX) -> ca.SX:
        f = K * d + (B + K * h) * d_dot
        return ca.if_else(f > 0.0, f, 0.0 * f)

    Rnb = R(q)
    v = ca.mtimes(Rnb, nu[:3])
    low, high = origin[:2] - 0.5 * size[:2], origin[:2] + 0.5 * size[:2]
    plane = [
        push(low[i] + r - position[i], -v[i]) - push(position[i] + r - high[i], v[i])
        for i in (0, 1)
    ]
    floor = origin[2] + size[2]
    down = -push(position[2] + half - floor, v[2])
    for x, y, width, tall in cylinders:
        away = position[:2] - ca.vertcat(x, y)
        distance = norm(away)
        n = away / ca.if_else(distance > 1e-6, distance, 1.0)
        f = push(width + r - distance, -ca.dot(n, v[:2]))
        reached = smoothstep((position[2] + half - (floor - tall)) / (half + 1e-6))
        f = ca.if_else(width > 0.0, f * reached, 0.0)
        plane = [plane[0] + f * n[0], plane[1] + f * n[1]]
    force = ca.mtimes(Rnb.T, ca.vertcat(*plane, down))
    force -= 0.5 * h * ca.cross(nu[3:], force)  # in the body's axes half a step later
    m.output(
        "tau", ca.vertcat(force, ca.SX.zeros(3)), unit=TAU, description="on the hull, about CO in b"
    )
    return m


def declare_arena(m: Model, obstacles: int) -> tuple[ca.SX, ca.SX, list[tuple[ca.SX, ...]]]:
    """Declare where a pool lies, and its obstacles; return (origin, size, [(x, y, r, h)])."""
    if not 0 <= obstacles <= 64:
        raise ParameterInvalid(m.name, f"{obstacles} obstacles", "0 to 64")
    origin = m.parameter(
        "origin", (0, 0, 0), unit="m", description="middle of the pool's surface, in NED"
    )
    size = m.parameter(
        "size", (2.6, 4.8, 1.1), unit="m", min=0, description="extent along N, E and D"
    )
    if not obstacles:
        return origin, size, []
    table = m.parameter(
        "obstacles",
        np.zeros((obstacles, 4)),
        unit="m",
        description="cylinders on the floor, one a row: N, E, radius, height; radius 0: none",
    )
    return origin, size, [tuple(table[i, j] for j in range(4)) for i in range(obstacles)]
