"""Target strength of a rigid sphere: the exact series, and its limits for small and large ka.

Source: Bowman, Senior and Uslenghi (1969), chapter 10.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["rigid_sphere", "rigid_sphere_large", "rigid_sphere_small"]

Array = NDArray[np.float64]
MOST = 20_000.0  # greatest ka of the series


def rigid_sphere(radius: ArrayLike, frequency: ArrayLike, c: float = 1500.0) -> Array:
    """Return the target strength [dB re 1 m²] of a fixed rigid sphere, to an incident plane wave.

    With the wave number k = 2 pi f / c and the radius a, the backscattering length is

        L = (1/k) | sum over n of (-1)^n (2 n + 1) j_n'(ka) / h_n'(ka) |,   TS = 20 log10 L,

    where j_n is the spherical Bessel function and h_n the spherical Hankel function.
    Raises `InputInvalid` for a radius, frequency or speed that is not above 0, and for ka above
    20,000.

    Example: a ball of 0.5 m at 450 kHz has almost the target strength of geometry, a²/4.

    >>> from uuvsim_cosim.models.acoustics.target_strength import rigid_sphere
    >>> round(float(rigid_sphere(0.5, 450e3)), 1)
    -12.0
    """
    from scipy.special import spherical_jn, spherical_yn

    a, f = np.broadcast_arrays(*_positive(radius=radius, frequency=frequency, c=c)[:2])
    result = np.empty(a.shape)
    for at in np.ndindex(a.shape):
        k = 2.0 * np.pi * f[at] / c
        x = float(k * a[at])
        if x > MOST:
            raise InputInvalid(
                f"target strength of a sphere: ka = {x:.0f}",
                f"at most {MOST:.0f}; above, rigid_sphere_large is exact to 0.01 dB",
            )
        n = np.arange(int(x + 4.05 * x ** (1.0 / 3.0)) + 3)
        j, y = spherical_jn(n, x, derivative=True), spherical_yn(n, x, derivative=True)
        series = np.where(n % 2, -1.0, 1.0) * (2 * n + 1) * j / (j + 1j * y)
        result[at] = 20.0 * np.log10(abs(series.sum()) / k)
    return result


def rigid_sphere_large(radius: ArrayLike) -> Array:
    """Return the target strength [dB re 1 m²] of a sphere of ka >> 1:  10 log10(a² / 4)."""
    (a,) = _positive(radius=radius)
    return np.asarray(20.0 * np.log10(a / 2.0))


def rigid_sphere_small(radius: ArrayLike, frequency: ArrayLike, c: float = 1500.0) -> Array:
    """Return the target strength [dB re 1 m²] of a sphere of ka << 1:  20 log10(5/6 k² a³)."""
    a, f, _ = _positive(radius=radius, frequency=frequency, c=c)
    return np.asarray(20.0 * np.log10(5.0 / 6.0 * (2.0 * np.pi * f / c) ** 2 * a**3))


def _positive(**given: ArrayLike) -> list[Array]:
    """Return the numbers as arrays; raise `InputInvalid` where one is not above 0."""
    for name, values in given.items():
        x = np.asarray(values, float)
        wrong = x[~((x > 0) & np.isfinite(x))]
        if wrong.size:
            place = "target strength of a sphere"
            raise InputInvalid(place, f"{name} {wrong.flat[0]:g}", "a finite number above 0")
    return [np.asarray(values, float) for values in given.values()]
