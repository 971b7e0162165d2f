"""A Kalman filter's steps on symbols: symmetric covariance, one scalar measurement at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

__all__ = ["Correction", "Measured", "pack", "propagated", "unpack"]


def unpack(upper: ca.SX, n: int) -> ca.SX:
    """Return the symmetric n x n matrix whose upper triangle is stored row by row."""
    P = ca.SX(n, n)
    k = 0
    for i in range(n):
        for j in range(i, n):
            P[i, j] = upper[k]
            P[j, i] = upper[k]
            k += 1
    return P


def pack(P: ca.SX) -> ca.SX:
    """Return the upper triangle, row by row."""
    n = P.size1()
    return ca.vertcat(*(P[i, j] for i in range(n) for j in range(i, n)))


def propagated(P: ca.SX, transition: Callable[[ca.SX], ca.SX], Q: ca.SX) -> ca.SX:
    """Return Phi (P + Q/2) Phi' + Q/2, where `transition` gives Phi X; symmetric by construction.

    Noise that comes in all along is as good as half of it at either end, to second order.
    """
    half = 0.5 * Q
    after = transition(transition(P + half).T)
    return unpack(pack(after + half), P.size1())


@dataclass(frozen=True)
class Measured:
    """One scalar: z - h(x) before correction, sparse row H, variance, and if it is new."""

    innovation: ca.SX
    H: ca.SX
    variance: ca.SX
    is_new: ca.SX


class Correction:
    """Scalar updates in sequence: P - w p p', dx + w p nu, with p = P H', S = H p + R, w = 1 / S.

    A measurement beyond `gate` deviations is left out, unless `insists` is true because too many in
    a row have been. `dx` is the error to inject afterwards.
    """

    def __init__(self, P: ca.SX, gate: ca.SX) -> None:
        self.P = P
        self.gate = gate
        self.n = P.size1()
        self.dx = ca.SX.zeros(self.n)

    def update(self, z: Measured, insists: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Take one scalar in; return (1 where it was left out by the gate, its nu²/S)."""
        P, H = self.P, z.H
        p = ca.densify(ca.mtimes(P, H.T))
        S = ca.mtimes(H, p) + z.variance
        w = 1.0 / S
        nu = z.innovation - ca.mtimes(H, self.dx)
        nis = nu * nu * w
        inside = ca.logic_or(nis < self.gate**2, insists)
        taken = ca.logic_and(z.is_new, inside)
        k = taken * w * p
        self.dx = self.dx + ca.if_else(taken, nu, 0.0) * k
        upper = [P[i, j] - k[i] * p[j] for i in range(self.n) for j in range(i, self.n)]
        self.P = unpack(ca.vertcat(*upper), self.n)
        refused = ca.if_else(ca.logic_and(z.is_new, ca.logic_not(inside)), 1.0, 0.0)
        return refused, nis

    def keep_unless(self, some: ca.SX, before: tuple[ca.SX, ca.SX]) -> None:
        """Restore `before` = (P, dx), unless there was `some` reading.

        Values do not change, because w is 0 without a reading; but the code can then skip them.
        """
        P, dx = before
        self.P = unpack(ca.if_else(some, pack(self.P), pack(P)), self.n)
        self.dx = ca.if_else(some, self.dx, dx)
