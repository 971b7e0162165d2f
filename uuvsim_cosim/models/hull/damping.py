"""Forces by the relative velocity: linear and quadratic damping, lift, SNAME's products.

    (D(nu_r) nu_r)_i  =  sum_j  D_l_ij nu_r_j  +  D_q_ij |nu_r_j| nu_r_j

is damping; both matrices are positive for a force that brakes (uuv_simulator and SNAME store
negatives).

    (lift)_i  =  sum_j  D_u_ij |u_r| nu_r_j

is the lift of a slender body and its fixed fins. With |u|, not u, it holds at any angle of attack
and astern: across the flow it is 1/2 rho S C_N V² sin(alpha) |cos(alpha)|, the first term of the
normal force on a slender body, which vanishes broadside; the other term, with sin²(alpha), is
cross-flow drag (Allen and Perkins 1951, NACA report 1048). A fin at x_f brakes v + x_f r wherever
the flow comes from. The Munk moment is no lift: it is in C_A, with the sign of u.

    (fading)_i  =  exp(-|v_r| / U_f) sum_j  D_f_ij nu_r_j

is linear damping at low speed (Fossen 2021, 2nd ed., chapter 6), which drag takes over from.

    (products)_i  =  sum  F_ab a b,     F in X Y Z K M N,   a, b in u v w p q r (in this order)

are those of SNAME: `Y_pq` is the coefficient of p q in Y, with the sign of SNAME: it adds to the
force. Products are what a published set has beside M_A, D_l and D_q. C_A is made of M_A here, so
that a product that a publication lists *combined* stands here less its part of C_A. What should
brake or lift in either direction is no product: |u| v belongs to `D_u`, |v| v to `D_q`.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from uuvsim_cosim.models.declaration.hull_parameters import product_of
from uuvsim_cosim.models.declaration.safe_math import abs_, norm

__all__ = ["damping", "fading", "lift", "products"]


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
