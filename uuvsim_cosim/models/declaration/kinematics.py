"""Attitude: rotations between NED `n` and body `b`, by unit quaternion or Euler angles.

Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed., chapter 2.
A quaternion q = (eta, eps1, eps2, eps3) is scalar first; Euler angles are zyx: phi, theta, psi.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.safe_math import atan2_or, safe_sqrt

__all__ = ["H", "R", "R_zyx", "S", "T_q", "T_zyx", "euler_of_q", "q_of_euler", "sparse"]


def sparse(rows: int, columns: int, entries: Mapping[tuple[int, int], Number]) -> ca.SX:
    """Return a matrix whose only entries, also structurally, are those given (from 0)."""
    M = ca.SX(rows, columns)
    for (i, j), value in entries.items():
        M[i, j] = value
    return M


def S(a: ca.SX) -> ca.SX:
    """Return the skew-symmetric matrix of  a x b = S b; zeros of `a` stay structural."""
    a = ca.SX(a)
    has = a.sparsity().has_nz
    places = {0: ((2, 1), (1, 2)), 1: ((0, 2), (2, 0)), 2: ((1, 0), (0, 1))}
    entries = {}
    for i, (plus, minus) in places.items():
        if has(i, 0):
            entries[plus], entries[minus] = a[i], -a[i]
    return sparse(3, 3, entries)


def R(q: ca.SX) -> ca.SX:
    """Return R from `b` to `n`; q is normalised here, so that its drift does no harm.

    R(q) = I + 2 eta S(eps) + 2 S(eps)², for |q| = 1.
    """
    s = 2.0 / ca.fmax(ca.sumsqr(q), 1e-300)  # an unset q = 0 counts as upright, not as NaN
    w, x, y, z = q[0], q[1], q[2], q[3]
    sx, sy, sz = s * x, s * y, s * z
    wx, wy, wz = w * sx, w * sy, w * sz
    xx, xy, xz = x * sx, x * sy, x * sz
    yy, yz, zz = y * sy, y * sz, z * sz
    return ca.vertcat(
        ca.horzcat(1.0 - (yy + zz), xy - wz, xz + wy),
        ca.horzcat(xy + wz, 1.0 - (xx + zz), yz - wx),
        ca.horzcat(xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


def T_q(q: ca.SX) -> ca.SX:
    """Return the 4x3 matrix T of  dq/dt = T omega."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return 0.5 * ca.vertcat(
        ca.horzcat(-x, -y, -z),
        ca.horzcat(w, -z, y),
        ca.horzcat(z, w, -x),
        ca.horzcat(-y, x, w),
    )


def R_zyx(phi: Number, theta: Number, psi: Number) -> ca.SX:
    """Return R from `b` to `n` of Euler angles [rad]."""
    cphi, sphi = ca.cos(phi), ca.sin(phi)
    cth, sth = ca.cos(theta), ca.sin(theta)
    cpsi, spsi = ca.cos(psi), ca.sin(psi)
    return ca.vertcat(
        ca.horzcat(cpsi * cth, -spsi * cphi + cpsi * sth * sphi, spsi * sphi + cpsi * cphi * sth),
        ca.horzcat(spsi * cth, cpsi * cphi + sphi * sth * spsi, -cpsi * sphi + sth * spsi * cphi),
        ca.horzcat(-sth, cth * sphi, cth * cphi),
    )


def T_zyx(phi: Number, theta: Number) -> ca.SX:
    """Return T of  (dphi, dtheta, dpsi)/dt = T omega; singular at theta = ±pi/2."""
    cphi, sphi = ca.cos(phi), ca.sin(phi)
    cth, tth = ca.cos(theta), ca.tan(theta)
    return ca.vertcat(
        ca.horzcat(1.0, sphi * tth, cphi * tth),
        ca.horzcat(0.0, cphi, -sphi),
        ca.horzcat(0.0, sphi / cth, cphi / cth),
    )


def q_of_euler(phi: Number, theta: Number, psi: Number) -> ca.SX:
    """Return the unit quaternion, scalar first, of Euler angles [rad]."""
    cphi, sphi = ca.cos(0.5 * phi), ca.sin(0.5 * phi)
    cth, sth = ca.cos(0.5 * theta), ca.sin(0.5 * theta)
    cpsi, spsi = ca.cos(0.5 * psi), ca.sin(0.5 * psi)
    return ca.vertcat(
        cpsi * cth * cphi + spsi * sth * sphi,
        cpsi * cth * sphi - spsi * sth * cphi,
        spsi * cth * sphi + cpsi * sth * cphi,
        spsi * cth * cphi - cpsi * sth * sphi,
    )


def euler_of_q(q: ca.SX) -> ca.SX:
    """Return (phi, theta, psi) [rad]; finite at the pole, where phi is 0 and psi all of it."""
    Rnb = R(q)
    theta = ca.atan2(-Rnb[2, 0], safe_sqrt(Rnb[0, 0] ** 2 + Rnb[1, 0] ** 2))
    phi = atan2_or(Rnb[2, 1], Rnb[2, 2], 0.0)
    psi = atan2_or(Rnb[1, 0], Rnb[0, 0], ca.atan2(-Rnb[0, 1], Rnb[1, 1]))
    return ca.vertcat(phi, theta, psi)


def H(r: ca.SX) -> ca.SX:
    """Return the 6x6 transformation from CO to the point r [m]:  nu_at_r = H nu."""
    I3 = ca.SX.eye(3)
    return ca.blockcat([[I3, S(r).T], [ca.SX(3, 3), I3]])
