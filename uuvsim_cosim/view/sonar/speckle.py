"""Statistics of speckle: how the levels of a flat patch of the seabed are distributed.

The sum of many scatterers with random phases has a complex Gaussian pressure. Its amplitude then
follows Rayleigh's distribution: the deviation over the mean is 0.523 for the amplitude and 1 for
the intensity, of which a share of exp(-3) = 0.0498 exceeds three times the mean. Samples that are
means of several cells vary less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["Speckle", "speckle"]

WINDOW = 61  # samples each way over which the mean level may not change


@dataclass(frozen=True)
class Speckle:
    """Statistics of a patch, after its mean level over neighbouring samples was divided out."""

    variation: float  # deviation over mean of the amplitude
    contrast: float  # deviation over mean of the intensity
    exceedance: float  # share of intensities above three times the mean


def speckle(magnitude: NDArray[np.floating]) -> Speckle:
    """Return the statistics of a patch (pings, bins) of a seabed without objects.

    Raises `InputInvalid` for a patch that is smaller than 61 by 61, and for one without echo.
    """
    from scipy.ndimage import uniform_filter

    a = np.asarray(magnitude, float)
    if a.ndim != 2 or min(a.shape) < WINDOW:
        raise InputInvalid("speckle", f"a patch {a.shape}", f"at least ({WINDOW}, {WINDOW})")
    level = uniform_filter(a, WINDOW)
    if not level.min() > 0.0:
        raise InputInvalid("speckle", "a patch without echo", "an echo everywhere")
    x = a / level
    x /= x.mean()
    intensity = x**2 / np.mean(x**2)
    return Speckle(float(x.std()), float(intensity.std()), float(np.mean(intensity > 3.0)))
