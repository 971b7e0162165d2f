"""Lift and drag of a hull with fixed wings: the forces on which a glider flies.

The flow relative to the water at x_w, where both forces act, is (u, v + x_w r, w - x_w q) in b.
With these components, named u, v, w, their size V and the angle of attack alpha:

    sin(alpha) = w / sqrt(u² + w²),   s = sin(alpha) held within ±sin(alpha_stall)
    lift = 1/2 rho S C_L_alpha s u             along  (w, 0, -u),  across the flow
    drag = 1/2 rho S (C_D_0 + C_D_alpha s²) V  against it, along  -(u, v, w)
    Z    = -1/2 rho S C_N (sin²(alpha) - s²) V² sign(w),  beyond the stall

For small alpha this is C_L = C_L_alpha alpha and C_D = C_D_0 + C_D_alpha alpha², the flight model
of Merckelbach et al. (2019) for a Slocum. Lift does no work, vanishes broadside, and damps pitch by
its lever. Beyond the stall, the flow across the hull makes a force normal to it: if that force were
along the flow, a glider that starts from rest would sink stalled. The Munk moment is not part of
this: C_A contains that moment.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.safe_math import norm, saturate

__all__ = ["wings"]


def wings(p: Mapping[str, ca.SX], rho: Number, nu_r: ca.SX) -> ca.SX:
    """Return lift and drag (6) [N, N.m] about CO in b, at the relative velocity nu_r.

    The force adds to the hull's (a brake is negative). rho [kg/m3] is that of the water.
    """
    v_w = nu_r[:3] + ca.vertcat(0.0, p["x_w"] * nu_r[5], -p["x_w"] * nu_r[4])
    u, w = v_w[0], v_w[2]
    across = norm(ca.vertcat(u, w))
    flows = across > 1e-12
    sine = ca.if_else(flows, w / ca.if_else(flows, across, 1.0), 0.0)
    s = saturate(sine, ca.sin(p["alpha_stall"]))
    C_D = p["C_D_0"] + p["C_D_alpha"] * s * s
    q_S = 0.5 * rho * p["S"]
    lift = q_S * p["C_L_alpha"] * s * u
    drag = q_S * C_D * norm(v_w)
    normal = q_S * p["C_N"] * (sine * sine - s * s) * ca.dot(v_w, v_w)
    push = ca.vertcat(lift * w, 0.0, -lift * u - ca.if_else(w > 0.0, normal, -normal))
    force = push - drag * v_w
    return ca.vertcat(force, 0.0, -p["x_w"] * force[2], p["x_w"] * force[1])
