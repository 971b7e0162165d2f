"""Invented relief between soundings: seeded noise within the uncertainty of the data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["add_relief"]

Floats = NDArray[np.float64]
_SHARE = 0.3  # of the interpolation's standard deviation that the relief takes up
_SLOPE = 3.0  # of the power spectrum, k^-3: between sand and rock of published seabeds
_LONGEST = 200.0  # m; of the relief's waves


def add_relief(
    z: Floats, distance: Floats, spread: Floats, spacing: float, seed: int,
    band: tuple[Floats, Floats],
) -> tuple[Floats, str]:  # fmt: skip
    """Add noise with a power-law spectrum to depths z; return the depths and a note on them.

    Nothing is added at the data; away from them the standard deviation is a share of that of the
    interpolation. Waves are longer than two spacings and shorter than the soundings' distance.
    The result stays within the charted band.
    """
    near = distance[np.isfinite(z)]
    longest = float(np.clip(2 * np.quantile(near, 0.9), 4 * spacing, max(_LONGEST, 4 * spacing)))
    # Gaussian noise with a power-law spectrum, band-limited, of unit variance.
    draws = np.random.Generator(np.random.Philox(key=seed)).standard_normal(z.shape)
    k = np.hypot(
        np.fft.fftfreq(z.shape[0], spacing)[:, None], np.fft.rfftfreq(z.shape[1], spacing)[None, :]
    )
    with np.errstate(divide="ignore"):
        gain = np.where((k > 1 / longest) & (k < 0.5 / spacing), k ** (-_SLOPE / 2), 0.0)
    noise = np.fft.irfft2(np.fft.rfft2(draws) * gain, s=z.shape)
    deviation = float(noise.std())
    noise = noise / deviation if deviation > 0 else noise
    room = np.where(np.isfinite(spread), spread, 0.0)
    taper = np.clip(distance / longest, 0.0, 1.0)
    added = np.clip(z + _SHARE * room * taper * noise, band[0], band[1])
    rms = float(np.sqrt(np.nanmean((added - z) ** 2)))
    return added, (
        f"relief shorter than {longest:.0f} m is invented (seed {seed}, {rms:.2f} m root mean "
        "square): no sounding saw it"
    )
