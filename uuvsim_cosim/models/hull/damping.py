"""Forces by the relative velocity: damping, lift, SNAME's products, cross-flow drag by strips.

    (D(nu_r) nu_r)_i  =  sum_j  D_l_ij nu_r_j  +  D_q_ij |nu_r_j| nu_r_j

is damping; both matrices are positive for a force that brakes (uuv_simulator and SNAME store
negatives).

    (lift)_i  =  sum_j  D_u_ij |u_r| nu_r_j

is the lift of a slender body and its fixed fins. With |u| instead of u, it is valid at any angle of
attack and astern. Across the flow it is 1/2 rho S C_N V² sin(alpha) |cos(alpha)|, the first term of
the normal force on a slender body, which vanishes broadside; the other term, with sin²(alpha), is
cross-flow drag (Allen and Perkins 1951, NACA report 1048). A fin at x_f brakes v + x_f r for any
direction of the flow. The Munk moment is not part of lift: it is in C_A, with the sign of u.

    (fading)_i  =  exp(-|v_r| / U_f) sum_j  D_f_ij nu_r_j

is linear damping at low speed (Fossen 2021, 2nd ed., chapter 6), which fades as drag grows.

    (products)_i  =  sum  F_ab a b,     F in X Y Z K M N,   a, b in u v w p q r (in this order)

are the products of SNAME: `Y_pq` is the coefficient of p q in Y, with the sign of SNAME (it adds to
the force). They are the terms that a published set has in addition to M_A, D_l and D_q. C_A is
computed from M_A here; therefore, if a publication lists a *combined* product, its part of C_A is
subtracted. Terms that brake or lift in both directions are not products: |u| v belongs to `D_u`,
and |v| v to `D_q`.

`cross_flow` is the drag of strips of the hull. At a station x the flow across is  v_x = v + x r,
w_x = w - x q,  U_x = sqrt(v_x² + w_x²), and

    dF = 1/2 rho (C_D_y h_y v_x² + C_D_z b_z w_x²) / U_x (v_x, w_x) dx

(Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3), 327-339). The size of the drag is that of the
face in the flow, its direction that of the flow, so the drag of a round hull does not depend on
roll. Y, Z and their moments M = -x dZ, N = x dY are summed over the length, with two Gauss-Legendre
points per strip. This is exact as long as the flow does not reverse within a strip, and it avoids
the extra strip of sums over N + 1 stations (+5 % for N = 20).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.hull_parameters import product_of
from uuvsim_cosim.models.declaration.safe_math import abs_, norm, safe_sqrt

__all__ = ["STRIPS", "cross_flow", "cross_flow_of", "damping", "fading", "lift", "products"]


def damping(D_l: ca.SX, D_q: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the generalised force D(nu_r) nu_r [N, N.m], structural zeros left out."""
    needed = {int(j) for _, j in zip(*ca.SX(D_q).sparsity().get_triplet(), strict=True)}
    square = ca.SX(6, 1)
    for j in needed:
        square[j] = abs_(nu_r[j]) * nu_r[j]
    return ca.mtimes(ca.SX(D_l), nu_r) + ca.mtimes(ca.SX(D_q), square)


def lift(D_u: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the generalised force [N, N.m] that D_u takes from the hull, positive for a brake."""
    return ca.mtimes(ca.SX(D_u), abs_(nu_r[0]) * nu_r)


def fading(D_f: ca.SX, U_f: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the generalised force [N, N.m] of damping that fades over the speed U_f [m/s]."""
    return ca.mtimes(ca.SX(D_f), ca.exp(-norm(nu_r[:3]) / U_f) * nu_r)


def products(p: Mapping[str, ca.SX], nu_r: ca.SX) -> ca.SX:
    """Return the generalised force (6) [N, N.m] of all products among the parameters."""
    force = ca.SX(6, 1)
    for name, coefficient in p.items():
        product = product_of(name)
        if product is not None:
            force[product.force] += coefficient * (nu_r[product.a] * nu_r[product.b])
    return force


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
