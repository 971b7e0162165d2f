"""Backstepping: velocity follows a virtual control that stabilises the pose (Lyapunov).

    nu_v = nu_b + Lambda e,   s = nu_v - nu
    tau  = M dnu_v/dt + C(nu) nu_v + D(nu) nu_v + g(eta) + K_d s + K_p e + R^T b,  db/dt = Gamma R s

With V = s'Ms/2 + e'K_p e/2 + (error of b)'Gamma^-1(error of b)/2,

    dV/dt = -s'(D + K_d)s - e'K_p Lambda e <= 0

for a K_p that is the same for all three forces (else a turn works on e). b is a constant unknown
force, kept in n, its moment in b; a current's push is such a force (Fossen 2021, 2nd ed.,
chapter 16: integrator backstepping; section not checked).
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.control.control_law import gains, law, nominal_hull
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.vectors import TAU

__all__ = ["backstepping"]


def backstepping(
    id: str = "bluerov2_backstepping", vehicle: str = "bluerov2_heavy", period: str = "0.02"
) -> Model:
    """Declare the law with a preset's gains and a vehicle's nominal hull."""
    p = preset("controllers", id, "controller")
    m = Model("backstepping", "Integrator backstepping with an estimate of the unknown force")
    loop, hull = law(m, p, period), nominal_hull(m, vehicle)
    Lambda, K_p, K_d, Gamma = gains(
        m,
        p,
        ("Lambda", "1/s", "1/s", "of e in the virtual velocity"),
        ("K_p", "N/m", "N.m/rad", "of e"),
        ("K_d", "N.s/m", "N.m.s/rad", "of s"),
        ("Gamma", "N/m", "N.m/rad", "rate of b, of s"),
    )
    limit = p.parameter(m, "tau_i_max", TAU, "limit of b", 6, min=0)
    b = loop.integral("b")
    nu_v = loop.nu_b + Lambda * loop.e
    nu_v_dot = loop.a_b + Lambda * loop.e_dot
    s = nu_v - loop.nu
    tau = (
        ca.mtimes(hull.M, nu_v_dot)
        + ca.mtimes(hull.C(loop.nu) + hull.D(loop.nu), nu_v)
        + hull.g(loop.eta)
        + K_d * s
        + K_p * loop.e
        + loop.in_body(b)
    )
    loop.close(tau, b, lambda short: loop.in_ned(Gamma * (s + short / K_d)), limit)
    return m
