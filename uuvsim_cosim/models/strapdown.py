"""Strapdown inertial navigation: the mechanisation, and how its errors grow.

At the IMU's place, p and v in NED, R(q) from `b` to `n`, with mean readings over dt:

    omega = gyro - b_g,  f = acc - b_a,  dq/dt = q ⊗ omega / 2,  dv/dt = R f + g,  dp/dt = v

Errors, true minus estimate; of velocity in `b`, y = R' v; of attitude R_true = R exp(S(dtheta)):

    ddp/dt = R (dy - S(y) dtheta),   gamma = R' g,
    ddy/dt = -S(omega) dy + S(gamma) dtheta - S(y) (db_g + n_g) - db_a - n_a,
    ddtheta/dt = -S(omega) dtheta - db_g - n_g

Only gravity ties tilt to velocity here. The error of v in `n` would be tied to it by S(f), and
a DVL's by S(y), both of which carry noise: station kept for long, a filter takes that noise for
motion and believes to see the tilt that it cannot tell from the accelerometers' bias.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from uuvsim_cosim.models.kinematics import R, S

__all__ = ["Inertial", "error_transition", "mechanised", "multiply", "q_of_rotation"]


@dataclass(frozen=True)
class Inertial:
    """Position and velocity of the IMU in `n` [m, m/s], attitude, biases in body axes."""

    p: Any
    v: Any
    q: Any
    b_g: Any
    b_a: Any


def q_of_rotation(a: Any) -> Any:
    """Give the unit quaternion of a small rotation vector [rad]; third order, normalised."""
    n = ca.sumsqr(a)
    q = ca.vertcat(1.0 - n / 8.0, (0.5 - n / 48.0) * a)
    return q / ca.sqrt(ca.sumsqr(q))


def multiply(a: Any, b: Any) -> Any:
    """Give the quaternion product a ⊗ b."""
    s = a[0] * b[0] - ca.dot(a[1:], b[1:])
    return ca.vertcat(s, a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))


def mechanised(x: Inertial, omega: Any, f: Any, g: Any, dt: Any) -> Inertial:
    """Advance by dt, with mean angular velocity and specific force in body axes over it."""
    middle = multiply(x.q, q_of_rotation(0.5 * dt * omega))
    v = x.v + dt * (ca.mtimes(R(middle), f) + ca.vertcat(0, 0, g))
    q = multiply(x.q, q_of_rotation(dt * omega))
    return Inertial(x.p + 0.5 * dt * (x.v + v), v, q / ca.sqrt(ca.sumsqr(q)), x.b_g, x.b_a)


def error_transition(x: Inertial, omega: Any, g: Any, dt: Any, decay: Any) -> Any:
    """Give F of the errors (dp, dy, dtheta, db_g, db_a, further ones that only decay)."""
    I3, O3 = ca.SX.eye(3), ca.SX(3, 3)
    Rnb = R(x.q)
    turn = I3 - dt * S(omega)
    tilt = dt * S(g * Rnb[2, :].T)
    Sy = S(ca.mtimes(Rnb.T, x.v))
    of_p = ca.mtimes(Rnb, 0.5 * tilt - Sy)
    inertial = ca.blockcat(
        [
            [I3, dt * Rnb, dt * of_p, O3, -0.5 * dt * dt * Rnb],
            [O3, turn, ca.mtimes(turn, tilt), -dt * (Sy + 0.5 * tilt), -dt * I3],
            [O3, O3, turn, -dt * I3, O3],
            [O3, O3, O3, I3, O3],
            [O3, O3, O3, O3, I3],
        ]
    )
    return ca.diagcat(inertial, ca.diag(decay))
