"""Lift and drag of a hull with fixed wings: the forces on which a glider flies.

The flow relative to the water at x_w, where both forces act, is (u, v + x_w r, w - x_w q) in b.
With these components, named u, v, w, their size V and the angle of attack alpha:

    sin(alpha) = w / sqrt(u² + w²),   s = sin(alpha) held within ±sin(alpha_stall)
    lift = 1/2 rho S C_L_alpha s u             along  (w, 0, -u),  across the flow
    drag = 1/2 rho S C_D V                     against it, along  -(u, v, w)
    C_D  = C_D_0 + C_D_alpha sin²(alpha),      at most C_D_n, that of the hull broadside

For small alpha this is C_L = C_L_alpha alpha and C_D = C_D_0 + C_D_alpha alpha², the flight model
of Merckelbach et al. (2019) for a Slocum. Lift does no work, vanishes broadside, and damps pitch by
its lever. The Munk moment is not part of it: C_A contains that moment.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.safe_math import clip, norm, saturate

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
    drag_at_angle = p["C_D_0"] + p["C_D_alpha"] * sine * sine
    C_D = clip(drag_at_angle, 0.0, p["C_D_n"])
    q_S = 0.5 * rho * p["S"]
    lift = q_S * p["C_L_alpha"] * s * u
    drag = q_S * C_D * norm(v_w)
    force = ca.vertcat(lift * w, 0.0, -lift * u) - drag * v_w
    return ca.vertcat(force, 0.0, -p["x_w"] * force[2], p["x_w"] * force[1])
