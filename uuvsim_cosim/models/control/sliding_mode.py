"""Sliding mode: the state is driven onto s = 0, and held there by a term of bounded size.

    s    = nu_b - nu + 2 lambda e + lambda² z,   dz/dt = e         (z in n, its angles in b)
    tau  = M dnu_v/dt + C(nu) nu_v + D(nu) nu_v + g(eta) + K_d s + K_s tanh(s / phi),  nu_v = nu + s

On s = 0 the error decays with the bandwidth lambda for any hull. s'Ms/2 falls as long as the force
that the nominal hull does not model is smaller than K_s (Fossen 2021, 2nd ed., chapter 16). tanh
with the boundary layer phi replaces the sign function and avoids chattering.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.control.control_law import gains, law, nominal_hull
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.vectors import per

__all__ = ["sliding_mode"]


def sliding_mode(
    id: str = "bluerov2_sliding_mode", vehicle: str = "bluerov2_heavy", period: str = "0.02"
) -> Model:
    """Declare the law with a preset's gains and a vehicle's nominal hull."""
    p = preset("controllers", id, "controller")
    m = Model("sliding_mode", "Sliding mode with integral and boundary layer")
    loop, hull = law(m, p, period), nominal_hull(m, vehicle)
    lambda_, K_d, K_s, phi = gains(
        m,
        p,
        ("lambda", "1/s", "1/s", "bandwidth on the sliding surface"),
        ("K_d", "N.s/m", "N.m.s/rad", "of s"),
        ("K_s", "N", "N.m", "largest force of the switching term"),
        ("phi", "m/s", "rad/s", "thickness of the boundary layer"),
    )
    units = per("m.s", "rad.s")
    limit = p.parameter(m, "z_max", units, "limit of z", 6, min=0)
    z = loop.integral("z", units)
    z_b = loop.in_body(z)
    s = loop.nu_b - loop.nu + 2.0 * lambda_ * loop.e + lambda_**2 * z_b
    turning = ca.vertcat(ca.cross(loop.nu[3:], z_b[:3]), ca.SX.zeros(3))
    nu_v_dot = loop.a_b + 2.0 * lambda_ * loop.e_dot + lambda_**2 * (loop.e - turning)
    nu_v = loop.nu + s
    tau = (
        ca.mtimes(hull.M, nu_v_dot)
        + ca.mtimes(hull.C(loop.nu) + hull.D(loop.nu), nu_v)
        + hull.g(loop.eta)
        + K_d * s
        + K_s * ca.tanh(s / phi)
    )
    back = 1.0 / (lambda_ * (K_d + K_s / phi) + 1e-9)
    loop.close(tau, z, lambda short: loop.in_ned(loop.e + back * short), limit)
    return m
