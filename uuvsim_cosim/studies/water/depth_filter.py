"""Kalman filter of the difference between a measured depth and that of a glide.

The water moves up and down too, and no model is exact. The difference z and its rate b follow

    z_dot = b        b_dot = -b / tau + noise        measured: z + noise

A prediction T seconds ahead is the modelled depth there, plus z + b tau (1 - exp(-T / tau)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

__all__ = ["DepthFilter", "filter_with_least_errors"]

Array = NDArray[np.float64]
Runs = tuple[tuple[int, int], ...]
_DECAYS = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)
_RATIOS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0)


@dataclass(frozen=True)
class DepthFilter:
    """Constants of the filter."""

    tau: float  # s, decay of the rate
    ratio: float  # 1/s3, power of the noise of the rate over that of the depth

    def estimates(self, z: Array, h: float, runs: Runs) -> tuple[Array, Array]:
        """Return z and b (K + 1,) at each point, by measurements z (K + 1,) not later than it.

        The measurements are `h` seconds apart, NaN for none. Each run begins without knowledge.
        """
        kept, noise = float(np.exp(-h / self.tau)), self.ratio * h
        moved = self.tau * (1.0 - kept)
        found, rate = np.full(len(z), np.nan), np.full(len(z), np.nan)
        for first, last in runs:
            x, b, known = 0.0, 0.0, False
            for k in range(first, last + 1):
                y = float(z[k])
                if not known:
                    if np.isnan(y):
                        continue
                    x, known = y, True
                    p, c, v = 1.0, 0.0, 0.5 * self.ratio * self.tau
                else:
                    x, b = x + moved * b, kept * b
                    p, c = p + moved * (2.0 * c + moved * v), kept * (c + moved * v)
                    v = kept * kept * v + noise
                    if not np.isnan(y):
                        gain, of_rate = p / (p + 1.0), c / (p + 1.0)
                        x, b = x + gain * (y - x), b + of_rate * (y - x)
                        p, c, v = p * (1.0 - gain), c * (1.0 - gain), v - of_rate * c
                found[k], rate[k] = x, b
        return found, rate

    def ahead(self, z: Array, b: Array, T: float) -> Array:
        """Return the difference T seconds later."""
        later: Array = z + b * self.tau * (1.0 - np.exp(-T / self.tau))
        return later


def filter_with_least_errors(
    z: Array, h: float, runs: Runs, seconds: Sequence[float]
) -> DepthFilter:
    """Return the filter with the smallest errors of predictions so many `seconds` ahead.

    The measure is the geometric mean of the RMS over `seconds`.
    """

    def error(constants: DepthFilter) -> float:
        found, rate = constants.estimates(z, h, runs)
        total = 0.0
        for T in seconds:
            steps = round(T / h)
            at = np.concatenate([np.arange(a, max(a, b - steps + 1)) for a, b in runs])
            wrong = constants.ahead(found[at], rate[at], T) - z[at + steps]
            total += float(np.log(np.nanmean(wrong**2)))
        return total

    return min((DepthFilter(t, r) for t, r in product(_DECAYS, _RATIOS)), key=error)
