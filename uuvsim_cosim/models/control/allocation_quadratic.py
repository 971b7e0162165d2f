"""Allocation to thrusters of quadratic thrust by a fixed pseudo-inverse: few operations.

    f = T^+ tau,   T^+ = T' (T T')^-1,   u_i = sign(f_i) sqrt(|f_i| / f_max)

as `allocation` with every thruster whole, and a thrust curve without a dead band. T^+ depends on
parameters alone. Where one thrust exceeds f_max, all are scaled by one factor, so that tau keeps
its direction. Below 1e-3 of f_max the curve is a line: the root's slope at 0 is infinite.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.actuators.thruster import largest_thrust
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import abs_, clip
from uuvsim_cosim.models.declaration.vectors import TAU
from uuvsim_cosim.models.hull.coriolis import inverse

__all__ = ["allocation_quadratic"]

LINEAR = 1e-3  # of f_max


def allocation_quadratic(vehicle: str = "pool8", thruster: str = "pool8_jet") -> Model:
    """Declare the allocation for a vehicle's thrusters, all alike, named by their preset."""
    geometry = thruster_geometry(vehicle)
    n = len(geometry.names)
    m = Model("allocation_quadratic", f"Fixed pseudo-inverse to {n} quadratic thrusters")
    tau_d = m.input("tau_d", 6, unit=TAU, description="wanted force about CO in b [N, N.m]")
    r = m.parameter("r", geometry.r, unit="m", description="positions from CO in b")
    e = m.parameter("e", geometry.e, unit="1", description="directions of positive thrust in b")
    f_max = m.parameter(
        "f_max", largest_thrust(thruster), unit="N", min=1e-6, description="largest, either way"
    )
    T = ca.horzcat(*(ca.vertcat(e[i, :].T, ca.cross(r[i, :].T, e[i, :].T)) for i in range(n)))
    T = ca.densify(T)
    T_inv = m.derived("T_inv", ca.mtimes(T.T, inverse(ca.mtimes(T, T.T) + 1e-9 * ca.SX.eye(6))))

    f = ca.mtimes(T_inv, tau_d) / f_max
    largest = ca.SX(1.0)
    for i in range(n):
        load = abs_(f[i])
        largest = ca.if_else(load > largest, load, largest)
    f = f / largest
    u = ca.vertcat(*(_command(f[i]) for i in range(n)))
    words = "; ".join(f"{i} {x}" for i, x in enumerate(geometry.names, 1))
    m.output("u", u, unit="1", description=words)
    m.output("saturation", 1.0 / largest, unit="1", description="1: tau_d is met; less: scaled")
    return m


def _command(f: ca.SX) -> ca.SX:
    """Return u of a thrust over f_max: odd, continuous, and sqrt beyond the line near 0."""
    size = abs_(f)
    root = ca.sqrt(clip(size, LINEAR, 1.0))
    return ca.if_else(size < LINEAR, f / LINEAR**0.5, ca.if_else(f < 0.0, -root, root))
