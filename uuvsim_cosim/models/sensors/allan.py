"""The Allan deviation: of a record, and in closed form of white noise with a Gauss-Markov bias.

With white noise of density N and a bias of stationary deviation sigma and correlation time tau,

    sigma_A²(t) = N² / t + 2 sigma² tau / t (1 - tau / (2 t) (3 - 4 e^(-t/tau) + e^(-2 t/tau)))

(IEEE Std 952-1997, annex C). A data sheet states N as angle or velocity random walk, and as bias
instability the lowest value of the curve. tau it does not state.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import ParameterInvalid

__all__ = ["allan_deviation", "allan_of_error", "lowest_allan", "sigma_of_instability"]

Array = NDArray[np.float64]
HUMP = 1.89  # t / tau at which a Gauss-Markov bias alone has its largest Allan deviation


def allan_deviation(record: ArrayLike, T: float, t: ArrayLike) -> Array:
    """Return the overlapping Allan deviation of records at averaging times `t` [s], shaped as `t`.

    `record` is (samples,) or (samples, series), all series of one process, taken every `T` [s]. The
    result is in its unit. The times are rounded to whole samples. Raises ParameterInvalid for a
    record that is not longer than twice the longest time.

    Example: white noise of density 0.1 m/s/√Hz at 100 Hz falls with the square root of the time.

    >>> import numpy as np
    >>> from uuvsim_cosim.models import allan_deviation
    >>> noise = np.random.default_rng(0).normal(0.0, 0.1 / np.sqrt(0.01), 20000)  # [m/s]
    >>> allan_deviation(noise, 0.01, [0.1, 1.0]).round(2)
    array([0.31, 0.11])
    """
    rows = np.asarray(record, dtype=float).reshape(len(np.asarray(record)), -1)
    sizes = np.maximum(np.rint(np.asarray(t, dtype=float) / T).astype(int), 1)
    if 2 * int(np.max(sizes)) >= len(rows):
        raise ParameterInvalid(
            (
                f"a record of {len(rows)} samples every {T:g} s for an averaging "
                f"time of {np.max(sizes) * T:g} s"
            ),
            "more than twice that time",
        )
    sums = np.vstack([np.zeros(rows.shape[1]), np.cumsum(rows - rows.mean(axis=0), axis=0)])
    found = []
    for m in np.atleast_1d(sizes):
        second = sums[2 * m :] - 2.0 * sums[m:-m] + sums[: -2 * m]
        found.append(np.sqrt(0.5 * np.mean(second**2)) / m)
    return np.array(found)


def allan_of_error(t: ArrayLike, N: float, sigma: float, tau: float) -> Array:
    """Return the Allan deviation of white noise with a Gauss-Markov bias, shaped as `t`.

    `t` are the averaging times [s], `N` is the density of the noise [x √s] for a signal in x,
    `sigma` [x] the stationary standard deviation of the bias, `tau` [s] its correlation time
    (IEEE Std 952-1997, annex C).

    Example: a bias of 0.05 m/s shows in the deviation at long averaging times.

    >>> from uuvsim_cosim.models import allan_of_error
    >>> allan_of_error([0.1, 1.0, 10.0], N=0.1, sigma=0.05, tau=100.0).round(3)
    array([0.316, 0.1  , 0.034])
    """
    times = np.asarray(t, dtype=float)
    x = times / tau
    e = np.expm1(-x)  # 3 - 4 e^-x + e^-2x = -2 e + e², without loss of figures at small x
    small = x < 1e-3
    inner = 1.0 - (e * e - 2.0 * e) / (2.0 * np.where(small, 1.0, x))
    bracket = np.where(small, x * x / 3.0, inner)
    return np.sqrt(N * N / times + 2.0 * sigma**2 * bracket / x)


def lowest_allan(N: float, sigma: float, tau: float) -> tuple[float, float]:
    """Return the lowest Allan deviation before the bias's own hump, and the time [s] it is at."""
    t = HUMP * tau * np.logspace(-6, 0, 6001)
    curve = allan_of_error(t, N, sigma, tau)
    i = int(np.argmin(curve))
    return float(curve[i]), float(t[i])


def sigma_of_instability(N: float, B: float, tau: float) -> float:
    """Return the sigma with which the lowest Allan deviation is a bias instability B.

    Raises ParameterInvalid where tau is too short for the white noise to fall to B.
    """
    if not (N >= 0.0 and B > 0.0 and tau > 0.0):
        raise ParameterInvalid(
            f"noise density {N:g}, bias instability {B:g}, tau {tau:g} s",
            "N at least 0, the others more than 0",
        )
    least = 4.0 * N * N / (B * B)
    if tau < least:
        raise ParameterInvalid(
            f"bias_tau {tau:g} s",
            (
                f"white noise of {N:g} falls to a bias instability of {B:g} only "
                f"after {0.5 * least:.4g} s"
            ),
            f"at least {least:.4g} s",
        )
    low, high = 0.0, 100.0 * B + N
    for _ in range(60):
        middle = 0.5 * (low + high)
        if lowest_allan(N, middle, tau)[0] < B:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
