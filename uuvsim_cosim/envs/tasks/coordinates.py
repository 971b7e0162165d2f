"""Poses of many environments in arrays: rotations, errors in body axes, angles (NED, FRD).

A function `…_expression` is the same for the symbols of one environment: it has the same operations
in the same order, and so the same bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.expressions import sin_cos

__all__ = [
    "R_zyx", "R_zyx_expression", "in_body", "in_body_expression", "level", "wrap",
    "wrap_expression",
]  # fmt: skip

Array = NDArray[np.float64]


def R_zyx(angles: Array) -> Array:
    """Return R from b to n, of shape (n, 3, 3), of phi theta psi (n, 3)."""
    s, c = sin_cos(angles)
    R = np.empty((len(angles), 3, 3))
    R[:, 0, 0] = c[:, 2] * c[:, 1]
    R[:, 0, 1] = c[:, 2] * s[:, 1] * s[:, 0] - s[:, 2] * c[:, 0]
    R[:, 0, 2] = c[:, 2] * s[:, 1] * c[:, 0] + s[:, 2] * s[:, 0]
    R[:, 1, 0] = s[:, 2] * c[:, 1]
    R[:, 1, 1] = s[:, 2] * s[:, 1] * s[:, 0] + c[:, 2] * c[:, 0]
    R[:, 1, 2] = s[:, 2] * s[:, 1] * c[:, 0] - c[:, 2] * s[:, 0]
    R[:, 2, 0] = -s[:, 1]
    R[:, 2, 1] = c[:, 1] * s[:, 0]
    R[:, 2, 2] = c[:, 1] * c[:, 0]
    return R


def in_body(R: Array, vectors: Array) -> Array:
    """Return vectors in b that are (n, ..., 3) in n."""
    n = len(R)
    flat = vectors.reshape(n, -1, 3)
    # Written out: the order of additions, and so the last bit, must not depend on n.
    x, y, z = (flat[:, :, i, None] * R[:, None, i, :] for i in range(3))
    return np.asarray(x + y + z).reshape(vectors.shape)


def level(psi: Array, vectors: Array) -> Array:
    """Turn vectors (n, ..., 2) of the horizontal plane into axes of heading psi (n,)."""
    shape = (len(psi),) + (1,) * (vectors.ndim - 2)
    s, c = (x.reshape(shape) for x in sin_cos(psi))
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def wrap(angle: Array) -> Array:
    """Return an angle within (-pi, pi]."""
    return np.asarray(np.pi - np.mod(np.pi - angle, 2 * np.pi))


def R_zyx_expression(phi: Any, theta: Any, psi: Any) -> list[list[Any]]:
    """Return the rows of R from b to n."""
    import casadi as ca

    (c0, c1, c2), (s0, s1, s2) = ([f(x) for x in (phi, theta, psi)] for f in (ca.cos, ca.sin))
    return [
        [c2 * c1, c2 * s1 * s0 - s2 * c0, c2 * s1 * c0 + s2 * s0],
        [s2 * c1, s2 * s1 * s0 + c2 * c0, s2 * s1 * c0 - c2 * s0],
        [-s1, c1 * s0, c1 * c0],
    ]


def in_body_expression(R: list[list[Any]], vector: Any) -> list[Any]:
    """Return a vector in b that is `vector` in n."""
    return [vector[0] * R[0][k] + vector[1] * R[1][k] + vector[2] * R[2][k] for k in range(3)]


def wrap_expression(angle: Any) -> Any:
    """Return an angle within (-pi, pi]."""
    import casadi as ca

    rest = ca.fmod(np.pi - angle, 2 * np.pi)
    return np.pi - ca.if_else(rest < 0.0, rest + 2 * np.pi, rest)
