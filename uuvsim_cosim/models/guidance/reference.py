"""Reference: a smooth curve in time, of which lines, circles, helices and lemniscates are cases.

    p(t) = origin + R_z(course) (U t + A_1 sin a,  A_2 sin 2 a + A_c (1 - cos a),  A_3 sin a + w t)

with a = rate t. A line has U alone; a lemniscate A_1 and A_2 (of Gerono: A_2 = A_1 / 2); a circle
A_1 = A_c, with w a helix. It starts at its origin; the bow points along the level part of its
velocity.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import atan2_or, norm
from uuvsim_cosim.models.declaration.vectors import ETA, NU

__all__ = ["reference"]

AHEAD = 4


def reference() -> Model:
    """Declare the curve: wanted pose and velocity now, and points of it still to come."""
    m = Model("reference", "Reference in time: line, circle, helix or lemniscate")
    origin = m.parameter("origin", (0.0, 0.0, 5.0), unit="m", description="p(0) in NED")
    course = m.parameter("course", 0.0, unit="rad", description="turns the curve about D")
    U = m.parameter("U", 0.0, unit="m/s", description="steady speed forwards")
    w = m.parameter("w", 0.0, unit="m/s", description="steady speed downwards")
    rate = m.parameter("rate", 0.1, unit="rad/s", description="of the angle a")
    A = m.parameter("A", (2.0, 1.0, 0.0), unit="m", description="amplitudes A_1 A_2 A_3")
    A_c = m.parameter("A_c", 0.0, unit="m", description="radius of a circle, as A_1 is")
    dt = m.parameter("dt_ahead", 0.5, unit="s", min=0, description="between points of `ahead`")

    def turned(x: ca.SX, y: ca.SX, z: ca.SX) -> ca.SX:
        c, s = ca.cos(course), ca.sin(course)
        return ca.vertcat(c * x - s * y, s * x + c * y, z)

    def p(t: ca.SX) -> ca.SX:
        a = rate * t
        sin, cos = ca.sin(a), ca.cos(a)
        y = A[1] * 2.0 * sin * cos + A_c * (1.0 - cos)
        return origin + turned(U * t + A[0] * sin, y, A[2] * sin + w * t)

    a = rate * m.t
    sin, cos = ca.sin(a), ca.cos(a)
    cos_2a = cos * cos - sin * sin
    v_x = U + A[0] * rate * cos
    v_y = rate * (2.0 * A[1] * cos_2a + A_c * sin)
    v_z = A[2] * rate * cos + w
    level = v_x * v_x + v_y * v_y
    moving = level > 1e-12
    bend = rate * rate * (v_x * (A_c * cos - 8.0 * A[1] * sin * cos) + v_y * A[0] * sin)
    psi = course + atan2_or(v_y, v_x, 0.0)
    r = ca.if_else(moving, bend / ca.if_else(moving, level, 1.0), 0.0)
    m.output(
        "eta_d",
        ca.vertcat(p(m.t), 0, 0, ca.atan2(ca.sin(psi), ca.cos(psi))),
        unit=ETA,
        description="wanted N E D [m], phi theta psi [rad]",
    )
    m.output(
        "nu_d",
        ca.vertcat(norm(ca.vertcat(v_x, v_y)), 0, v_z, 0, 0, r),
        unit=NU,
        description="wanted, in axes of eta_d [m/s, rad/s]",
    )
    m.output(
        "ahead",
        ca.vertcat(*(p(m.t + (i + 1) * dt) for i in range(AHEAD))),
        unit="m",
        description=f"N E D of {AHEAD} points still to come, one after the other",
    )
    return m
