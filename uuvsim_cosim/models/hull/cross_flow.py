"""Cross-flow drag by strips of the hull.

At a station x the flow across is  v_x = v + x r,  w_x = w - x q,  U_x = sqrt(v_x² + w_x²), and

    dF = 1/2 rho (C_D_y h_y v_x² + C_D_z b_z w_x²) / U_x (v_x, w_x) dx

(Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3), 327-339): the drag's size is that of the face
that is met, its direction that of the flow, so that a round hull is the same at any roll. Y, Z and
their moments M = -x dZ, N = x dY are summed over the length. Each strip takes two points of Gauss
and Legendre: exact as long as the flow does not turn within a strip, and without the extra strip
that sums over N + 1 stations have (+5 % for N = 20).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.safe_math import safe_sqrt

__all__ = ["STRIPS", "cross_flow", "cross_flow_of"]

STRIPS = 10


def cross_flow_of(p: Mapping[str, ca.SX], nu_r: ca.SX) -> ca.SX:
    """Return the drag (6) [N, N.m] by the parameters of a hull that lists strips."""
    k_y = 0.5 * p["rho"] * p["C_D_y"] * p["h_y"] if "C_D_y" in p else 0.0
    k_z = 0.5 * p["rho"] * p["C_D_z"] * p["b_z"] if "C_D_z" in p else 0.0
    return cross_flow(nu_r, p["x_stern"], p["x_bow"], k_y, k_z)


def cross_flow(
    nu_r: ca.SX | np.ndarray,
    x_stern: Number,
    x_bow: Number,
    k_y: Number,
    k_z: Number,
    strips: int = STRIPS,
) -> ca.SX:
    """Return the drag (6) [N, N.m] of a hull from x_stern to x_bow [m]; positive for a brake.

    k = 1/2 rho C_D times the mean height or breadth [N.s2/m3] of what is seen from that side.
    """
    v, w, q, r = nu_r[1], nu_r[2], nu_r[4], nu_r[5]
    width = (x_bow - x_stern) / strips
    Y, Z, M, N = (ca.SX(0.0) for _ in range(4))
    for i in range(strips):
        for offset in (-0.5 / sqrt(3.0), 0.5 / sqrt(3.0)):
            x = x_stern + (i + 0.5 + offset) * width
            v_x, w_x = v + x * r, w - x * q
            v_2, w_2 = v_x * v_x, w_x * w_x
            square = v_2 + w_2
            flows = square > 1e-24
            k = ca.if_else(flows, (k_y * v_2 + k_z * w_2) / ca.if_else(flows, square, 1.0), 0.0)
            push = k * safe_sqrt(square)
            Y += push * v_x
            Z += push * w_x
            M -= push * w_x * x
            N += push * v_x * x
    half = 0.5 * width
    force = ca.SX(6, 1)
    force[1], force[2], force[4], force[5] = half * Y, half * Z, half * M, half * N
    return force
