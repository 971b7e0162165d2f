"""Poses of many environments in arrays: rotations, errors in body axes, angles (NED, FRD)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["R_zyx", "in_body", "level", "wrap"]

Array = NDArray[np.float64]


def R_zyx(angles: Array) -> Array:
    """Return R from b to n, of shape (n, 3, 3), of phi theta psi (n, 3)."""
    c, s = np.cos(angles), np.sin(angles)
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
    turned = sum(flat[:, :, i, None] * R[:, None, i, :] for i in range(3))
    return np.asarray(turned).reshape(vectors.shape)


def level(psi: Array, vectors: Array) -> Array:
    """Turn vectors (n, ..., 2) of the horizontal plane into axes of heading psi (n,)."""
    shape = (len(psi),) + (1,) * (vectors.ndim - 2)
    c, s = np.cos(psi).reshape(shape), np.sin(psi).reshape(shape)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x + s * y, c * y - s * x], axis=-1)


def wrap(angle: Array) -> Array:
    """Return an angle within (-pi, pi]."""
    return np.asarray(np.pi - np.mod(np.pi - angle, 2 * np.pi))
