"""Feedback linearisation: the hull's own terms are cancelled; six oscillators remain.

    tau = M a + C(nu) nu + D(nu) nu + g(eta) + z
    a   = dnu_b/dt + 2 zeta omega de/dt + omega² e,     dz/dt = M omega³/10 e

so that d²e/dt² + 2 zeta omega de/dt + omega² e = 0 for the nominal hull (Fossen 2021, 2nd ed.,
chapter 16, section not checked; for manipulators: computed torque). The integral z, in n, estimates
the force that the nominal hull does not model, by Fossen's rule of a tenth of the bandwidth (as in
his MSS, SIMnpsauv.m).
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.control.control_law import gains, law, nominal_hull
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.vectors import TAU

__all__ = ["feedback_linearisation"]


def feedback_linearisation(
    id: str = "bluerov2_feedback_linearisation",
    vehicle: str = "bluerov2_heavy",
    period: str = "0.02",
) -> Model:
    """Declare the law with a preset's bandwidths and a vehicle's nominal hull."""
    p = preset("controllers", id, "controller")
    m = Model("feedback_linearisation", "Feedback linearisation (computed torque) with integral")
    loop, hull = law(m, p, period), nominal_hull(m, vehicle)
    omega, zeta = gains(
        m,
        p,
        ("omega", "rad/s", "rad/s", "natural frequency of the error"),
        ("zeta", "1", "1", "damping ratio of the error"),
    )
    limit = p.parameter(m, "tau_i_max", TAU, "limit of z", 6, min=0)
    z = loop.integral("z")
    a = loop.a_b + 2.0 * zeta * omega * loop.e_dot + omega**2 * loop.e
    nu = loop.nu
    known = ca.mtimes(hull.C(nu) + hull.D(nu), nu) + hull.g(loop.eta)
    tau = ca.mtimes(hull.M, a) + known + loop.in_body(z)
    weight = ca.diag(hull.M)

    def grow(short: ca.SX) -> ca.SX:
        return loop.in_ned(0.1 * omega * (weight * omega**2 * loop.e + short))

    loop.close(tau, z, grow, limit)
    return m
