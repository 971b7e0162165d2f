"""The right-hand side of npsauv.m in its own order: hull, planes and propeller, strips."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["mss_control", "mss_force", "mss_strips", "sign_errors"]

Array = NDArray[np.float64]
L, RHO = 5.3, 1025.0


def mss_force(nu: Array) -> Array:
    """Healey and Lienard's hull as npsauv.m sums it: derivatives, rigid body, no cross-flow."""
    u, v, w, p, q, r = nu
    m, z, I = 53400 / 9.81, 0.061, {"x": 2038.0, "y": 13587.0, "z": 13587.0, "xy": -13.58}  # noqa: E741
    r2, r3, r4, r5 = (0.5 * RHO * L**k for k in (2, 3, 4, 5))
    I_off = I["xy"]
    X = r2 * (0.053 * v * v + 0.17 * w * w) + r3 * (0.02 * v * r - 0.2 * w * q - 0.003 * v * p)
    X += r4 * (-0.015 * q * q + 0.004 * r * r + 7.5e-4 * p * r + 7e-3 * p * p)
    X += m * (v * r - w * q) - m * z * p * r - r2 * 0.00385 * u * u
    Y = r2 * (-0.1 * u * v + 0.068 * v * w)
    Y += r3 * (0.003 * u * p + 0.03 * u * r + 0.024 * v * q + 0.23 * w * p - 0.019 * w * r)
    Y += r4 * (0.004 * p * q - 0.0065 * q * r) - m * (u * r - w * p + z * q * r)
    Z = r2 * (-0.3 * w * u - 0.068 * v * v) + r3 * (-0.14 * u * q - 0.048 * v * p + 0.045 * v * r)
    Z += r4 * (1.3e-4 * p * p + 6.7e-3 * p * r - 7.4e-3 * r * r)
    Z += m * (v * p - u * q - z * (p * p + q * q))
    K = r3 * (3.1e-3 * u * v - 0.19 * v * w)
    K += r4 * (-1.1e-2 * u * p - 8.4e-4 * u * r - 5.1e-3 * v * q - 1.3e-4 * w * p + 1.4e-2 * w * r)
    K += r5 * (-6.9e-5 * p * q + 1.7e-2 * q * r)
    K += (I["y"] - I["z"]) * q * r + I_off * (p * q - p * r - r * r + q * q)
    K += m * z * (u * r - w * p)
    M = r3 * (0.1 * u * w - 0.026 * v * v) + r4 * (-0.068 * u * q + 1.2e-3 * v * p + 1.7e-2 * v * r)
    M += r5 * (5.3e-5 * p * p + 5e-3 * p * r + 2.9e-3 * r * r)
    M += -(I["z"] - I["x"]) * p * r + I_off * (q * r - p * q - p * p + r * r)
    M += -m * z * (w * q - v * r)
    N = r3 * (-7.4e-3 * u * v - 2.7e-2 * v * w)
    N += r4 * (-8.4e-4 * u * p - 1.6e-2 * u * r - 1e-2 * v * q - 1.7e-2 * w * p + 7.4e-3 * w * r)
    N += r5 * (-2.1e-2 * p * q + 2.7e-3 * q * r)
    N += (I["x"] - I["y"]) * p * q + I_off * (p * p - q * q + p * r - q * r)
    return np.array([X, Y, Z, K, M, N])


def sign_errors(nu: Array) -> Array:
    """What npsauv.m has with the other sign than Newton's law: our force less that of MSS.

    Z: m (v p - u q - z_G (p² + q²)) for its negative; M: -(I_z - I_x) p r for (I_z - I_x) p r.
    """
    u, v, _, p, q, r = nu
    m, z = 53400 / 9.81, 0.061
    off = np.zeros(6)
    off[2] = -2 * m * (v * p - u * q - z * (p * p + q * q))
    off[4] = 2 * (13587 - 2038) * p * r
    return off


def mss_control(nu: Array, act: Sequence[float], U: float) -> Array:
    """Return the planes' and the propeller's part of npsauv.m (nu is relative to the water)."""
    u, v, w, _, q, r = nu
    dr, ds, dbp, dbs, rpm = act
    n, db = rpm / 60 * 2 * np.pi, dbp + dbs
    r2, r3, r4 = (0.5 * RHO * L**k for k in (2, 3, 4))
    eta = 0.012 * n / U
    root, root_1 = (np.sqrt(0.004 * L**2 * x + 1) - 1 for x in (eta * abs(eta), 1.0))
    eps = -1 + root / (root_1 + 1e-10)
    X = r3 * (-1e-3 * u * r * dr + (2.5e-2 * ds - 1.3e-3 * db) * u * q)
    X += r2 * (1.7e-3 * u * v * dr + (4.6e-2 * ds + 5e-3 * db) * u * w)
    X += r2 * (-1e-2 * ds * ds - 1e-2 * dr * dr) * u * u + r3 * 2e-3 * u * q * ds * eps
    X += r2 * (3.5e-3 * u * w * ds - 1.6e-3 * u * u * ds * ds) * eps
    X += r2 * u * u * 0.00385 * eta * abs(eta)  # its - 1 is in the hull's drag
    Z = r2 * u * u * (-7.3e-2 * ds - 1.3e-2 * db) + r3 * -2.9e-3 * u * q * eps
    Z += r2 * (-5.1e-3 * u * w - 1e-2 * u * u * ds) * eps
    K = r4 * -5.7e-4 * u * nu[3] * eps
    M = r4 * -1.6e-3 * u * q * eps + r3 * (-2.9e-3 * w * u - 5.2e-3 * u * u * ds) * eps
    M += r3 * u * u * (-4.1e-2 * ds + 3.5e-3 * db)
    return np.array([X, r2 * 2.7e-2 * u * u * dr, Z, K, M, r3 * u * u * -1.3e-2 * dr])


def mss_strips(nu: Array) -> Array:
    """Return its cross-flow drag: eleven stations for ten strips, and (w + x q) in pitch."""
    _, v, w, _, q, r = nu
    x = np.linspace(-L / 2, L / 2, 11)
    U = np.hypot(v + x * r, w - x * q) + 1e-6
    k = 0.5 * RHO * 0.53 * (0.5 * (v + x * r) ** 2 + 0.6 * (w - x * q) ** 2) / U * L / 10
    Y, Z, M = k * (v + x * r), k * (w - x * q), k * (w + x * q)
    return -np.array([0, Y.sum(), Z.sum(), 0, (x * M).sum(), (x * Y).sum()])
