"""Lift of a slender body and its fixed fins, as damping that grows with speed along the axis.

    (lift)_i  =  sum_j  D_u_ij |u_r| nu_r_j

With |u|, not u, it holds at any angle of attack and astern: across the flow it is
1/2 rho S C_N V² sin(alpha) |cos(alpha)|, the first term of the normal force on a slender body,
which vanishes broadside; the other term, with sin²(alpha), is cross-flow drag (Allen and Perkins
1951, NACA report 1048). A fin at x_f brakes v + x_f r wherever the flow comes from. The Munk moment
is no lift: it is in C_A, with the sign of u.

    (fading)_i  =  exp(-|v_r| / U_f) sum_j  D_f_ij nu_r_j

is linear damping at low speed (Fossen 2021, 2nd ed., chapter 6), which drag takes over from.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.safe_math import abs_, norm

__all__ = ["fading", "lift"]


def lift(D_u: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the generalised force [N, N.m] that D_u takes from the hull, positive for a brake."""
    return ca.mtimes(ca.SX(D_u), abs_(nu_r[0]) * nu_r)


def fading(D_f: ca.SX, U_f: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the generalised force [N, N.m] of damping that fades over the speed U_f [m/s]."""
    return ca.mtimes(ca.SX(D_f), ca.exp(-norm(nu_r[:3]) / U_f) * nu_r)
