"""Optics of Jerlov's water types: attenuation and backscatter of a camera's three channels.

Jerlov's types are defined by the diffuse attenuation K of daylight over the wavelength: Jerlov
(1976), Table XXVII. A camera also needs the attenuation c = a + b of a beam, which those tables do
not have. It is reconstructed in three steps:

1. Scattering b at 514 nm follows log-log from K at 525 nm, through the three waters of Petzold
   (1972): clear ocean, coastal ocean and turbid harbour. It is extended in a straight line.
2. Over the wavelength, b falls as 1 / wavelength, as of particles (assumption).
3. Absorption a follows from Kirk (1984), with the sun overhead: K² = a² + 0.235 a b.

A channel sees a band of wavelengths. Akkaynak and Treibitz (2018) derive two coefficients of it at
a distance z: `beta_D` of the light that comes from an object, and `beta_B` of the veiling light,

    beta_D = ln(sum S E / sum S E e^(-c z)) / z,
    beta_B = -ln(1 - sum S E b/c (1 - e^(-c z)) / sum S E b/c) / z.

S is the channel's response, E the daylight that is left at a depth. V = sum S E b/c / (4 pi sum S
E) is the radiance of infinite water over the irradiance, if all directions scatter alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["WATERS", "WAVELENGTHS", "WaterOptics", "spectra", "water_optics"]

Array = NDArray[np.float64]
WAVELENGTHS = np.arange(400, 701, 25)  # nm
# K [1/m] at WAVELENGTHS: Jerlov (1976), Table XXVII.
WATERS: dict[str, tuple[float, ...]] = {
    "I": (.028, .022, .019, .018, .027, .043, .063, .089, .235, .305, .36, .42, .56),
    "IA": (.038, .031, .026, .025, .032, .048, .067, .094, .24, .31, .37, .43, .57),
    "IB": (.051, .042, .036, .033, .042, .054, .072, .099, .245, .315, .375, .435, .58),
    "II": (.096, .081, .068, .062, .07, .076, .089, .115, .26, .335, .4, .465, .61),
    "III": (.185, .16, .135, .116, .115, .116, .12, .148, .295, .375, .445, .52, .66),
    "1C": (.51, .36, .25, .17, .14, .13, .12, .15, .3, .37, .45, .51, .65),
    "3C": (.78, .54, .39, .29, .22, .2, .19, .21, .33, .4, .46, .56, .71),
    "5C": (1.1, .78, .56, .43, .36, .31, .3, .33, .4, .48, .54, .65, .8),
    "7C": (1.6, 1.2, .89, .71, .58, .49, .46, .46, .48, .54, .63, .78, .92),
    "9C": (2.4, 1.9, 1.6, 1.23, .99, .78, .63, .58, .6, .65, .76, .92, 1.1),
}  # fmt: skip
# a and b [1/m] at 514 nm: Petzold (1972), AUTEC, HAOCE and San Diego harbour.
PETZOLD = np.array([[0.114, 0.037], [0.179, 0.219], [0.366, 1.824]])
KIRK = 0.235  # 0.425 - 0.190, with the sun overhead
# Middle and standard deviation [nm] of the response of red, green and blue (assumption).
CHANNELS = ((600.0, 30.0), (535.0, 35.0), (460.0, 30.0))


@dataclass(frozen=True, eq=False)
class WaterOptics:
    """Coefficients of red, green and blue (3,)."""

    beta_D: Array  # 1/m, of the light from an object
    beta_B: Array  # 1/m, of the veiling light
    K: Array  # 1/m, of daylight over depth
    b: Array  # 1/m, scattering
    V: Array  # 1/sr, radiance of infinite water over the irradiance of daylight


def spectra(water: str) -> tuple[Array, Array, Array]:
    """Return K, absorption a and scattering b [1/m] of a water type at WAVELENGTHS."""
    if water not in WATERS:
        raise InputInvalid("water", f"{water!r}", expected_names(water, WATERS))
    K = np.array(WATERS[water])
    known = np.log([_diffuse(a, b) for a, b in PETZOLD])
    scattering = np.log(PETZOLD[:, 1])
    at = np.log(K[WAVELENGTHS == 525][0])
    i = 0 if at < known[1] else 1
    slope = (scattering[i + 1] - scattering[i]) / (known[i + 1] - known[i])
    b = np.exp(scattering[i] + slope * (at - known[i])) * 514.0 / WAVELENGTHS
    a = 0.5 * (np.sqrt((KIRK * b) ** 2 + 4.0 * K**2) - KIRK * b)
    return K, a, b


def water_optics(water: str, distance: float = 3.0, depth: float = 5.0) -> WaterOptics:
    """Return the coefficients of a water type, for a distance and a depth [m].

    They depend on both slightly, as a channel is a band: a camera uses one set for all pixels.
    Raises InputInvalid for a type that Jerlov's table does not have.
    """
    K, a, b = spectra(water)
    c = a + b
    S = np.array([np.exp(-0.5 * ((WAVELENGTHS - m) / s) ** 2) for m, s in CHANNELS])
    E = S * np.exp(-K * depth)
    left = np.exp(-c * distance)
    veil = E * (b / c)
    found = (
        np.log(E.sum(1) / (E * left).sum(1)) / distance,
        -np.log(1.0 - (veil * (1.0 - left)).sum(1) / veil.sum(1)) / distance,
        np.log(S.sum(1) / E.sum(1)) / depth,
        (E * b).sum(1) / E.sum(1),
        veil.sum(1) / E.sum(1) / (4.0 * np.pi),
    )
    return WaterOptics(*(np.round(each, 6) for each in found))


def _diffuse(a: float, b: float) -> float:
    return float(np.sqrt(a * a + KIRK * a * b))
