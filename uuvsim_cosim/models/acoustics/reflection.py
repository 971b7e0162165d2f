"""Reflection of sound at the bottom and at the surface of the water: coefficients of the pressure.

A smooth bottom reflects by Rayleigh's coefficient for two fluids, Kinsler et al. (2000), chapter 6,
with the complex wave number of APL-UW TR 9407, section IV. Of a rough boundary, the coherent
reflection is that of the smooth one times exp(-Gamma^2 / 2), Gamma = 2 k sigma sin(theta), with the
wave number k and the rms height sigma (Jensen et al. (2011), chapter 1). The rest is scattered.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["coherent_share", "rayleigh"]


def rayleigh(theta: ArrayLike, rho: float, nu: float, delta: float = 0.0) -> NDArray[np.complex128]:
    """Return the reflection coefficient at grazing angles `theta` [rad] of a smooth fluid bottom.

    `rho` and `nu` are the density and the speed of sound of the bottom over those of the water,
    `delta` the imaginary over the real part of its wave number. The phase is that of exp(-i w t).
    Shear waves in rock and metal are left out. An infinite `rho` is a rigid bottom. Raises
    `InputInvalid` for numbers that are not above 0, and for a `delta` below 0.

    Example: at normal incidence on sand, (rho nu - 1) / (rho nu + 1).

    >>> from uuvsim_cosim.models.acoustics.reflection import rayleigh
    >>> import numpy as np
    >>> round(float(abs(rayleigh(np.pi / 2, rho=1.845, nu=1.1782))), 3)
    0.37
    """
    if not (rho > 0.0 and 0.0 < nu < np.inf and 0.0 <= delta < np.inf):
        found = f"rho {rho:g}, nu {nu:g}, delta {delta:g}"
        raise InputInvalid(
            "reflection at the bottom", found, "rho and nu above 0, delta of 0 or more"
        )
    angle = np.asarray(theta, float)
    if np.isinf(rho):
        return np.ones(angle.shape, complex)
    P = np.sqrt(np.asarray(((1.0 + 1j * delta) / nu) ** 2 - np.cos(angle) ** 2, complex))
    y = rho * np.sin(angle)
    return np.asarray((y - P) / (y + P))


def coherent_share(theta: ArrayLike, rms: float, k: float) -> NDArray[np.float64]:
    """Return exp(-Gamma^2 / 2), the share of the pressure that a rough boundary reflects
    coherently.

    `theta` [rad] is the grazing angle, `rms` [m] the height of the roughness, `k` [1/m] the wave
    number. Raises `InputInvalid` for an `rms` that is negative or not finite.

    Example: ripples of 1 mm at 450 kHz and 20 degrees.

    >>> from uuvsim_cosim.models.acoustics.reflection import coherent_share
    >>> import numpy as np
    >>> round(float(coherent_share(np.radians(20.0), rms=1e-3, k=2 * np.pi * 450e3 / 1500)), 3)
    0.435
    """
    if not 0.0 <= rms < np.inf:
        raise InputInvalid("reflection at a rough boundary", f"rms height {rms:g} m", "0 or more")
    return np.asarray(np.exp(-2.0 * (k * rms * np.sin(np.asarray(theta, float))) ** 2))
