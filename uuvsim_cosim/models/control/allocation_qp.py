"""Allocation by a quadratic programme: the nearest force within the limits of the thrusters.

    min over f of  (T f - tau)' W (T f - tau) / 2 + epsilon f'f / 2,
    such that      -h_i f_min <= f_i <= h_i f_max

with W = diag(weight) and h the health (Fossen 2021, 2nd ed., chapter 11: constrained allocation).
Where `allocation` scales all thrusts by one factor, this one lets a saturated or lost thruster's
share go to the others. It begins at the pseudo-inverse and descends along one thrust after the
other, `sweeps` times, each a little beyond its best (by 1.3): every step lowers the cost, so that
it can be stopped anywhere. Five sweeps miss the exact force by 0.1 % on average, 1.2 % at worst.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.control.allocation import command_of_thrust
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.vectors import TAU
from uuvsim_cosim.models.hull.coriolis import inverse
from uuvsim_cosim.models.intrinsics.table import table1

__all__ = ["allocation_qp"]

ARM = 0.2  # m: an error of 1 N.m weighs as much as one of 1 / ARM N
EPSILON = 1e-3
BEYOND = 1.3


def allocation_qp(
    vehicle: str = "bluerov2_heavy",
    thruster: str = "t200",
    voltage: float | str = 16.0,
    sweeps: int | str = 5,
) -> Model:
    """Declare the allocation for a vehicle's thrusters at a nominal supply voltage."""
    geometry = thruster_geometry(vehicle)
    n = len(geometry.names)
    thrusts, commands = command_of_thrust(thruster, float(voltage))
    curve = table1(thrusts, commands)
    m = Model("allocation_qp", f"Quadratic programme for {n} thrusters of {vehicle}")
    tau_d = m.input("tau_d", 6, unit=TAU, description="wanted force about CO in b [N, N.m]")
    health = m.input(
        "health", n, unit="1", start=(1.0,) * n, min=0, max=1, description="0: failed; 1: whole"
    )
    r = m.parameter("r", geometry.r, unit="m", description="positions from CO in b")
    e = m.parameter("e", geometry.e, unit="1", description="directions of positive thrust in b")
    f_max = m.parameter("f_max", thrusts[-1], unit="N", min=1e-6, description="largest forward")
    f_min = m.parameter("f_min", -thrusts[0], unit="N", min=1e-6, description="largest backward")
    weight = m.parameter(
        "weight",
        (1.0,) * 3 + (ARM**-2,) * 3,
        unit=("1/N2",) * 3 + ("1/(N2.m2)",) * 3,
        min=1e-9,
        description="of errors of force and of moment",
    )
    T = m.derived(
        "T",
        ca.densify(
            ca.horzcat(*(ca.vertcat(e[i, :].T, ca.cross(r[i, :].T, e[i, :].T)) for i in range(n)))
        ),
    )
    TW = ca.mtimes(T.T, ca.diag(weight))
    cost = ca.mtimes(TW, T) + EPSILON * ca.SX.eye(n)
    H = m.derived("H", ca.densify(cost))
    start = m.derived("start", ca.densify(ca.mtimes(inverse(cost), TW)))
    share = clip(health, 0.0, 1.0)
    wanted = ca.mtimes(TW, tau_d)
    whole = ca.mtimes(start, tau_d)
    f = [clip(whole[i], -share[i] * f_min, share[i] * f_max) for i in range(n)]
    for _ in range(int(sweeps)):
        for i in range(n):
            slope = wanted[i] - sum(H[i, j] * f[j] for j in range(n))
            f[i] = clip(f[i] + BEYOND * slope / H[i, i], -share[i] * f_min, share[i] * f_max)
    thrust = ca.vertcat(*f)
    made = ca.mtimes(T, thrust)
    size = ca.dot(tau_d, weight * tau_d)
    met = ca.if_else(
        size > 1e-9, ca.dot(made, weight * tau_d) / ca.if_else(size > 1e-9, size, 1.0), 1.0
    )
    u = ca.vertcat(*(curve(f[i]) for i in range(n)))
    names = "; ".join(f"{i} {x}" for i, x in enumerate(geometry.names, 1))
    m.output("u", u, unit="1", description=names)
    m.output("f", thrust, unit="N", description="thrust that is expected of each thruster")
    m.output("saturation", met, unit="1", description="share of tau_d that is met; 1: all")
    return m
