"""Strapdown inertial navigation: the mechanisation, and how its errors grow.

At the IMU's place, p and v in NED, R(q) from `b` to `n`, with mean readings over dt:

    omega = gyro - b_g,  f = acc - b_a,  dq/dt = q ⊗ omega / 2,  dv/dt = R f + g,  dp/dt = v

Errors are true minus estimate, in `n` (the biases in `b`); with R_true = exp(S(eta)) R,

    zeta = exp(-S(eta)) v_true - v,   dp/dt = zeta - S(v) eta,   deta/dt = -R (db_g + n_g),
    dzeta/dt = S(g) eta - S(v) R (db_g + n_g) - R (db_a + n_a)

zeta is the error of the velocity in body axes, rotated into `n`. Only gravity couples it to tilt.
The error of v itself would be coupled to tilt by S(f), and a DVL reading by S(y); both contain
noise. During long station keeping, a filter would interpret this noise as motion, and would wrongly
reduce the uncertainty of tilt, which cannot be separated from the accelerometers' bias. In `n`,
only R and v vary in these equations, so one transition may span many steps of the mechanisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R, S, sparse

__all__ = [
    "ErrorTransition",
    "Inertial",
    "corrected",
    "mechanised",
    "multiply",
    "q_of_rotation",
    "transported",
]


@dataclass(frozen=True)
class Inertial:
    """Position and velocity of the IMU in `n` [m, m/s], attitude, biases in body axes."""

    p: ca.SX
    v: ca.SX
    q: ca.SX
    b_g: ca.SX
    b_a: ca.SX


def _turn(a: ca.SX) -> ca.SX:
    """Return the quaternion of a small rotation vector [rad]; third order, not normalised."""
    n = ca.sumsqr(a)
    return ca.vertcat(1.0 - n / 8.0, (0.5 - n / 48.0) * a)


def _unit(q: ca.SX) -> ca.SX:
    return q / ca.sqrt(ca.sumsqr(q))


def q_of_rotation(a: ca.SX) -> ca.SX:
    """Return the unit quaternion of a small rotation vector [rad]; third order, normalised."""
    return _unit(_turn(a))


def multiply(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the quaternion product a ⊗ b."""
    s = a[0] * b[0] - ca.dot(a[1:], b[1:])
    return ca.vertcat(s, a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))


def mechanised(x: Inertial, omega: ca.SX, f: ca.SX, g: ca.SX, dt: ca.SX) -> Inertial:
    """Advance by dt, with mean angular velocity and specific force in body axes over it."""
    half = _turn(0.5 * dt * omega)
    middle = multiply(x.q, half)
    v = x.v + dt * (ca.mtimes(R(middle), f) + ca.vertcat(0, 0, g))
    q = _unit(multiply(middle, half))
    return Inertial(x.p + 0.5 * dt * (x.v + v), v, q, x.b_g, x.b_a)


def corrected(x: Inertial, e: ca.SX) -> Inertial:
    """Return the estimate with its errors (dp, zeta, eta, db_g, db_a, ...) taken out."""
    turn = _turn(e[6:9])
    q = _unit(multiply(turn, x.q))
    v = ca.mtimes(R(turn), x.v + e[3:6])
    return Inertial(x.p + e[:3], v, q, x.b_g + e[9:12], x.b_a + e[12:15])


def transported(P: ca.SX, before: ca.SX, after: ca.SX) -> ca.SX:
    """Return the covariance after a correction that turned the attitude from `before` to `after`.

    The errors of the biases are rotated back in body axes, so that they do not change in `n`. If
    tilt cannot be separated from the accelerometers' bias, the indistinguishable errors satisfy
    S(g) eta = R db_a with the present R. Without the rotation, each correction would seem to
    separate them.
    """
    M = ca.SX.eye(P.size1())
    M[9:12, 9:12] = M[12:15, 12:15] = ca.mtimes(R(after).T, R(before))
    return ca.mtimes(ca.mtimes(M, P), M.T)


@dataclass(frozen=True)
class ErrorTransition:
    """How the errors (dp, zeta, eta, db_g, db_a, further ones that only decay) grow over t.

    Exact to second order in t, by the way dp of the estimate and the mean of R meanwhile.
    """

    t: ca.SX
    way: ca.SX
    mean_R: ca.SX
    g: ca.SX
    decay: ca.SX

    def __call__(self, e: ca.SX) -> ca.SX:
        """Return Phi e, for one column or many."""
        t, half = self.t, 0.5 * self.t * self.t
        S_g = sparse(3, 3, {(0, 1): -self.g, (1, 0): self.g})
        p, zeta, eta, b_g, b_a, rest = ca.vertsplit(e, [0, 3, 6, 9, 12, 15, e.size1()])
        turned_g, turned_a = ca.mtimes(self.mean_R, b_g), ca.mtimes(self.mean_R, b_a)
        Sw = S(self.way)
        return ca.vertcat(
            p + t * zeta + ca.mtimes(half * S_g - Sw, eta) - half * turned_a,
            zeta + t * (ca.mtimes(S_g, eta) - turned_a) - ca.mtimes(half * S_g + Sw, turned_g),
            eta - t * turned_g,
            b_g,
            b_a,
            ca.mtimes(ca.diag(self.decay), rest),
        )
