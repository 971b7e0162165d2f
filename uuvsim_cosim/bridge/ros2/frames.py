"""Frames of ROS (REP 103, REP 105): world ENU instead of NED, body FLU instead of FRD.

A vector in the world turns by the half turn about north-east, one in the body by the half turn
about the x axis,

    (e, n, u) = (y, x, -z),   (f, l, u) = (x, -y, -z),

and a rotation R from body to world becomes R_ENU_NED R R_FRD_FLU. Both half turns are their own
inverses, so `world` and `body` convert in both directions. A quaternion is (w, x, y, z) in
this project and (x, y, z, w) in ROS.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Array",
    "body",
    "body_quaternion",
    "euler_angles",
    "euler_quaternion",
    "from_quaternion",
    "quaternion",
    "world",
    "world_variance",
]

Array: TypeAlias = NDArray[Any]


def world(v: Array) -> Array:
    """Return vectors (n, 3) in ENU of vectors in NED, and the reverse."""
    return np.stack([v[:, 1], v[:, 0], -v[:, 2]], axis=1)


def body(v: Array) -> Array:
    """Return vectors (n, 3) in FLU of vectors in FRD, and the reverse."""
    return np.multiply(v, [1.0, -1.0, -1.0])


def world_variance(variance: Array) -> Array:
    """Return variances (n, 3) along ENU of those along NED."""
    return variance[:, [1, 0, 2]]


def quaternion(q: Array) -> Array:
    """Return quaternions (n, 4) x y z w from FLU to ENU of those w x y z from FRD to NED.

    It is -(0, a, a, 0) q (0, 1, 0, 0) with a = 1/√2 as Hamilton products of w x y z; the sign does
    not change the rotation.
    """
    w, x, y, z = q.T
    turned: Array = np.sqrt(0.5) * np.stack([x + y, x - y, w - z, w + z], axis=1)
    return turned


def from_quaternion(q: Array) -> Array:
    """Return quaternions (n, 4) w x y z from FRD to NED of those x y z w from FLU to ENU.

    It is the inverse of `quaternion`, up to the sign, which does not change the rotation.
    """
    x, y, z, w = q.T
    turned: Array = np.sqrt(0.5) * np.stack([z + w, x + y, x - y, w - z], axis=1)
    return turned


def body_quaternion(q: Array) -> Array:
    """Return quaternions (n, 4) x y z w between FLU frames of those w x y z between FRD frames."""
    return np.multiply(q[:, [1, 2, 3, 0]], [1.0, -1.0, -1.0, 1.0])


def euler_quaternion(angles: Array) -> Array:
    """Return quaternions (n, 4) w x y z of angles (n, 3) phi theta psi [rad], z-y-x."""
    (sf, st, sp), (cf, ct, cp) = np.sin(angles.T / 2), np.cos(angles.T / 2)
    return np.stack(
        [
            cf * ct * cp + sf * st * sp,
            sf * ct * cp - cf * st * sp,
            cf * st * cp + sf * ct * sp,
            cf * ct * sp - sf * st * cp,
        ],
        axis=1,
    )


def euler_angles(q: Array) -> Array:
    """Return angles (n, 3) phi theta psi [rad], z-y-x, of unit quaternions (n, 4) w x y z."""
    w, x, y, z = q.T
    return np.stack(
        [
            np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
            np.arcsin(np.clip(2 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        ],
        axis=1,
    )
