"""Coriolis and centripetal forces about CO, C_RB, C_A and C of M_RB + M_A; the inverse of M.

Fossen (2021), 2nd ed., section 3.3 (C_RB in the form that is independent of linear velocity) and
Theorem 3.2 (C from any M, here `m2c`, Munk moment included). M_RB is in `declaration/inertia.py`,
M_A in `matrices.py`: positive as written here (M_A = -[X_udot ...] in SNAME's derivatives),
constant, in body axes. A published matrix that is not symmetric is kept as it is.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.kinematics import S

__all__ = ["C_RB", "coriolis", "inverse", "m2c"]


def C_RB(m: Number, I_b: ca.SX, r_g: ca.SX, omega: ca.SX) -> ca.SX:
    """Return the 6x6 C_RB of omega = (p, q, r) alone, so that C_RB nu_r serves in a current too."""
    Sr, mS = S(r_g), m * S(omega)
    I_g = I_b + m * ca.mtimes(Sr, Sr)
    rotation = -ca.mtimes(ca.mtimes(Sr, mS), Sr) - S(ca.mtimes(I_g, omega))
    return ca.blockcat([[mS, -ca.mtimes(mS, Sr)], [ca.mtimes(Sr, mS), rotation]])


def m2c(M: ca.SX, nu: ca.SX) -> ca.SX:
    """Return the skew-symmetric C(nu) of a 6x6 M, as published (M is not made symmetric)."""
    momentum = ca.mtimes(ca.SX(M), nu)
    a, b = momentum[:3], momentum[3:]
    return ca.blockcat([[ca.SX(3, 3), -S(a)], [-S(a), -S(b)]])


def coriolis(M: ca.SX, nu: ca.SX) -> ca.SX:
    """Return m2c(M, nu) nu without forming the matrix:  (w x a, v x a + w x b), (a, b) = M nu."""
    momentum = ca.mtimes(ca.SX(M), nu)
    a, b = momentum[:3], momentum[3:]
    v, w = nu[:3], nu[3:]
    return ca.vertcat(ca.cross(w, a), ca.cross(v, a) + ca.cross(w, b))


def inverse(M: ca.SX) -> ca.SX:
    """Return M⁻¹ by elimination without pivots, for M with positive definite symmetric part.

    Structural zeros of M⁻¹ are kept, so the generated code has no unnecessary instructions.
    """
    M = ca.SX(M)
    n = M.size1()
    has = M.sparsity().has_nz
    A: list[dict[int, ca.SX]] = [{j: M[i, j] for j in range(n) if has(i, j)} for i in range(n)]
    X: list[dict[int, ca.SX]] = [{i: ca.SX(1)} for i in range(n)]

    def subtract(target: dict[int, ca.SX], factor: ca.SX, source: dict[int, ca.SX]) -> None:
        for j, value in source.items():
            target[j] = target[j] - factor * value if j in target else -factor * value

    for k in range(n):
        pivot = A[k][k]
        X[k] = {j: value / pivot for j, value in X[k].items()}
        A[k] = {j: value / pivot for j, value in A[k].items() if j > k}
        for i in range(n):
            if i != k and k in A[i]:
                factor = A[i].pop(k)
                subtract(A[i], factor, A[k])
                subtract(X[i], factor, X[k])
    out = ca.SX(n, n)
    for i in range(n):
        for j, value in X[i].items():
            out[i, j] = value
    return out
