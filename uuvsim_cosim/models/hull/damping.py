"""Damping: D(nu_r) nu_r, linear and quadratic, with off-diagonals.

    (D(nu_r) nu_r)_i  =  sum_j  D_l_ij nu_r_j  +  D_q_ij |nu_r_j| nu_r_j

Both matrices are positive for a force that brakes (uuv_simulator and SNAME store negatives).
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.safe_math import abs_

__all__ = ["D", "damping"]


def D(D_l: ca.SX, D_q: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the 6x6 damping matrix  D_l + D_q diag|nu_r|."""
    return D_l + ca.mtimes(D_q, ca.diag(abs_(nu_r)))


def damping(D_l: ca.SX, D_q: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the generalised force D(nu_r) nu_r [N, N.m], structural zeros left out."""
    needed = {int(j) for _, j in zip(*ca.SX(D_q).sparsity().get_triplet(), strict=True)}
    square = ca.SX(6, 1)
    for j in needed:
        square[j] = abs_(nu_r[j]) * nu_r[j]
    return ca.mtimes(ca.SX(D_l), nu_r) + ca.mtimes(ca.SX(D_q), square)
