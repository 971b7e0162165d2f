"""Added mass: M_A and C_A of the water that accelerates with the hull.

M_A is positive as written here (M_A = -[X_udot ...] in SNAME's derivatives), constant, about CO
and in body axes. A published matrix that is not symmetric is kept as it is.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.hull.rigid_body import m2c

__all__ = ["C_A"]


def C_A(M_A: ca.SX, nu_r: ca.SX) -> ca.SX:
    """Return the 6x6 matrix at nu_r, Munk moment included; Fossen (2021), 2nd ed., Theorem 3.2."""
    return m2c(M_A, nu_r)
