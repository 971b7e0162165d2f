"""Backscattering strength of surfaces over grazing angle: Lambert's law, and sediments by APL-UW.

The strength is S_b = 10 log10 sigma, where sigma is the backscattering cross section per unit area
and unit solid angle. The grazing angle theta lies between the ray and the surface.

Sediments: APL-UW TR 9407 (1994), section IV, with the number of the equation at each step. sigma is
the sum of what the rough interface scatters (the Kirchhoff approximation near normal incidence, the
composite-roughness approximation elsewhere, an empirical form for gravel and rock) and of what the
volume of the sediment scatters. The relief spectrum has centimetres as its unit of length, and so
has the wave number in these equations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import atan, erf, exp, gamma, log, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.models.acoustics.valid_range import Valid, refuse_outside

__all__ = ["APL_UW_RANGES", "Sediment", "apl_uw", "grain_size", "lambert"]

Array = NDArray[np.float64]

APL_UW_RANGES = {  # section IV.A.8
    "frequency": Valid(10e3, 100e3, "Hz"),
    "speed of sound": Valid(1400.0, 1600.0, "m/s"),
    "grazing angle": Valid(0.0, pi / 2 + 1e-12, "rad"),
    "rho": Valid(1.0, 3.0, ""),
    "nu": Valid(0.8, 3.0, ""),
    "delta": Valid(0.0, 0.1, ""),
    "sigma_2": Valid(0.0, 1.0, ""),
    "gamma": Valid(2.4, 3.9, ""),
    "w_2": Valid(0.0, 1.0, "cm^4"),
}
LEAST = 0.001 * pi / 180.0  # rad: below, the strength at this angle is returned (IV.C.4)
C_TABLE = 1.528  # m/ms: speed of sound of eq. (4)
# Three-point Gauss-Hermite quadrature over the slope: weights, and nodes in slopes (47, 48).
WEIGHTS = (0.295410, 1.181636, 0.295410)
NODES = (1.224745, 0.0, -1.224745)


@dataclass(frozen=True)
class Sediment:
    """The six inputs of APL-UW's model of the bottom (table 1)."""

    rho: float  # density of the sediment over that of the water
    nu: float  # speed of sound in the sediment over that in the water
    delta: float  # imaginary over real part of the wave number in the sediment
    sigma_2: float  # volume scattering cross section over the attenuation coefficient
    w_2: float  # cm^4, spectral strength of the relief
    gamma: float = 3.25  # spectral exponent of the relief


def grain_size(M_z: float) -> Sediment:
    """Return the sediment of a mean grain size M_z [phi], -1 to 9; eqs. (2) to (10)."""
    refuse_outside("sediment by grain size", {"M_z": Valid(-1.0, 9.0, "phi")}, {"M_z": M_z})
    M = M_z
    if M < 1.0:
        rho = 0.007797 * M**2 - 0.17057 * M + 2.3139
        nu = 0.002709 * M**2 - 0.056452 * M + 1.2778
    elif M < 5.3:
        rho = -0.0165406 * M**3 + 0.2290201 * M**2 - 1.1069031 * M + 3.0455
        nu = -0.0014881 * M**3 + 0.0213937 * M**2 - 0.1382798 * M + 1.3425
    else:
        rho = -0.0012973 * M + 1.1565
        nu = -0.0024324 * M + 1.0019
    if M < 0.0:
        attenuation = 0.4556  # dB/(m kHz)
    elif M < 2.6:
        attenuation = 0.4556 + 0.0245 * M
    elif M < 4.5:
        attenuation = 0.1978 + 0.1245 * M
    elif M < 6.0:
        attenuation = 8.0399 - 2.5228 * M + 0.20098 * M**2
    else:
        attenuation = 0.9431 - 0.2041 * M + 0.0117 * M**2
    delta = attenuation * nu * C_TABLE * log(10.0) / (40.0 * pi)
    h = (2.03846 - 0.26923 * M) / (1.0 + 0.076923 * M) if M < 5.0 else 0.5  # cm
    return Sediment(rho, nu, delta, 0.002 if M < 5.5 else 0.001, 0.00207 * h**2)


def lambert(theta: ArrayLike, mu: float) -> Array:
    """Return sigma = mu sin²(theta), Lambert's law.

    A surface that scatters all that it reflects, with the energy reflection coefficient |R|²,
    has mu = |R|² / pi.
    """
    return np.asarray(mu * np.sin(np.asarray(theta, float)) ** 2)


def apl_uw(theta: ArrayLike, frequency: float, p: Sediment, c: float = 1500.0) -> Array:
    """Return sigma of a sediment at each grazing angle `theta` [rad]; APL-UW TR 9407, (34) to (66).

    `c` [m/s] is the speed of sound in the water at the bottom. Raises `InputInvalid` outside of
    the ranges of `APL_UW_RANGES`, such as 10 to 100 kHz. The authors state an uncertainty of 3 dB
    for a sand or silt that is well characterised, and of about 10 dB for rock and gravel.

    Example: backscattering strength of medium sand at 40 kHz and 20 degrees.

    >>> import numpy as np
    >>> from uuvsim_cosim.models.acoustics.backscatter import apl_uw, grain_size
    >>> sigma = apl_uw(np.radians(20.0), 40e3, grain_size(1.5))
    >>> round(10 * float(np.log10(sigma)), 1)
    -27.4
    """
    theta = np.asarray(theta, float)
    inputs = {name: getattr(p, name) for name in ("rho", "nu", "delta", "sigma_2", "gamma", "w_2")}
    given = {"frequency": frequency, "speed of sound": c, "grazing angle": theta, **inputs}
    refuse_outside("backscatter by APL-UW TR 9407", APL_UW_RANGES, given)
    angles: Array = np.maximum(theta, LEAST)
    k = 2.0 * pi * frequency / (100.0 * c)  # 1/cm
    alpha = p.gamma / 2.0 - 1.0
    s = _slope(k, alpha, p.w_2)
    shadow = _shadow(angles, s)

    # Interface: two approximations of smooth bottoms, joined where Kirchhoff's has lost 15 dB.
    q = _q_c(k, alpha, p.w_2)
    a = _kirchhoff_a(alpha)
    smooth = shadow * _over_slopes(angles, s, lambda t: _small_roughness(t, k, p))
    steep = _kirchhoff(angles, alpha, a, q, _R2(p))
    c_4 = 1000.0 ** (1.0 / (1.0 + alpha)) * (a * q * q) ** (1.0 / alpha)
    near = _fade((np.cos(angles) - (4.0 + 1.0 / c_4) ** -0.25) / 0.0125)
    medium = near * steep + (1.0 - near) * smooth
    rough = _large_roughness(angles, s, p)
    fine = float(_fade((np.degrees(atan(s)) - 7.0) / 0.5))
    volume = shadow * _over_slopes(angles, s, lambda t: _volume(t, p))
    return np.asarray(fine * medium + (1.0 - fine) * rough + volume)


def _kappa(p: Sediment) -> complex:
    return (1.0 + 1j * p.delta) / p.nu


def _P(theta: Array | float, p: Sediment) -> NDArray[np.complex128]:
    """Return P = sqrt(kappa² - cos²(theta)), with half the phase of the argument (32)."""
    return np.asarray(np.sqrt(np.asarray(_kappa(p) ** 2 - np.cos(theta) ** 2, complex)))


def _reflection(theta: Array | float, p: Sediment) -> NDArray[np.complex128]:
    """Return Rayleigh's reflection coefficient of a fluid with losses (30, 31)."""
    y = p.rho * np.sin(theta) / _P(theta, p)
    return np.asarray((y - 1.0) / (y + 1.0))


def _R2(p: Sediment) -> float:
    """Return the share of the energy that is reflected at normal incidence."""
    return abs(complex(_reflection(pi / 2, p))) ** 2


def _slope(k: float, alpha: float, w_2: float) -> float:
    """Return the rms slope of the relief that is long against the wave (42)."""
    power = (1.0 - alpha) / alpha
    s2 = (2.0 * pi * w_2) ** (1.0 / alpha) / (2.0 * (1.0 - alpha)) * (k * k / alpha) ** power
    return sqrt(s2)


def _q_c(k: float, alpha: float, w_2: float) -> float:
    """Return q_c, from the structure constant C_h² of the relief (38, 39)."""
    C_h2 = 2.0 * pi * w_2 * gamma(2.0 - alpha) * 2.0 ** (-2.0 * alpha)
    C_h2 /= alpha * (1.0 - alpha) * gamma(1.0 + alpha)
    return float(C_h2 * 2.0 ** (1.0 - 2.0 * alpha) * k ** (2.0 * (1.0 - alpha)))


def _kirchhoff_a(alpha: float) -> float:
    half = 0.5 / alpha
    return float(
        (8.0 * alpha**2 * gamma(half + 0.5) / (gamma(0.5) * gamma(2.0 * half) * gamma(half)))
        ** (2.0 * alpha)
    )


def _kirchhoff(theta: Array, alpha: float, a: float, q: float, R2: float) -> Array:
    """Return the Kirchhoff approximation (35 to 37); it counts from 40 degrees.

    Its factor b = a^(1/2 + 1/(2 alpha)) Gamma(1/alpha) / (2 alpha) makes it equal to Kirchhoff's
    integral at normal incidence.
    """
    power = (1.0 + alpha) / (2.0 * alpha)
    b = a**power * gamma(1.0 / alpha) / (2.0 * alpha)
    below = np.cos(theta) ** (4.0 * alpha) + a * q * q * np.sin(theta) ** 4
    return np.where(theta >= np.radians(40.0), b * q * R2 / (8.0 * pi * below**power), 0.0)


def _small_roughness(theta: Array, k: float, p: Sediment) -> Array:
    """Return the small-roughness perturbation approximation (50 to 52)."""
    kappa = _kappa(p)
    Y = (p.rho - 1.0) ** 2 * np.cos(theta) ** 2 + p.rho**2 - kappa**2
    Y = Y / (p.rho * np.sin(theta) + _P(theta, p)) ** 2
    K = k * np.sqrt(4.0 * np.cos(theta) ** 2 + 0.01)
    W = p.w_2 * K**-p.gamma
    return np.asarray(4.0 * k**4 * np.sin(theta) ** 4 * np.abs(Y) ** 2 * W)


def _volume(theta: Array, p: Sediment) -> Array:
    """Return the scattering of the sediment's volume, as one of its surface (66)."""
    P = _P(theta, p)
    through = np.abs(1.0 - _reflection(theta, p) ** 2) ** 2 * np.sin(theta) ** 2
    lost = p.nu * log(10.0) * np.abs(P) ** 2 * P.imag
    return np.where(theta > 0.0, 5.0 * p.delta * p.sigma_2 * through / lost, 0.0)


def _large_roughness(theta: Array, s: float, p: Sediment) -> Array:
    """Return the empirical form for gravel and rock (53 to 56); angles in degrees."""
    degrees, s_deg = np.degrees(theta), np.degrees(s)
    critical = np.degrees(np.arccos(1.0 / p.nu)) if p.nu >= 1.001 else 2.5613
    sigma_1 = 0.04682 * s**1.25 * p.nu**3.25 * ((1.0 - 2.0 / p.rho) / p.nu**2 + 1.0) ** 2
    sigma_1 /= 1.0 + 3.54 * s_deg / critical
    beyond = 1.0 + 0.81 * critical**2 / degrees**2
    peak = s * s * (1.0 + (degrees - 90.0) ** 2 / (2.6 * s_deg**2)) ** 1.9 * beyond
    wide = np.sin(pi / beyond) ** (0.7263 * s ** (-1.0 / 3.0))
    return np.asarray(sigma_1 * wide + 0.0260 * _R2(p) / peak)


def _shadow(theta: Array, s: float) -> Array:
    """Return the share of the bottom that other parts of it do not hide (43 to 45)."""

    def seen(t: float) -> float:
        if t > 2.0:
            return 1.0
        Q = (exp(-t * t) / sqrt(pi) - t * (1.0 - erf(t))) / (4.0 * t)
        return (1.0 - exp(-2.0 * Q)) / (2.0 * Q)

    t = np.tan(theta) / s
    return np.array([seen(float(x)) for x in t.ravel()]).reshape(t.shape)


def _over_slopes(theta: Array, s: float, cross_section: Callable[[Array], Array]) -> Array:
    """Return the mean of a cross section over the slopes of the bottom (46 to 49)."""
    total = np.zeros_like(theta)
    for weight, node in zip(WEIGHTS, NODES, strict=True):
        total += weight * cross_section(np.clip(theta - node * s, 0.0, pi / 2))
    return total / sqrt(pi)


def _fade(x: ArrayLike) -> Array:
    """Return 1 / (1 + exp(x)), which joins two approximations (57)."""
    return np.asarray(1.0 / (1.0 + np.exp(np.clip(x, -40.0, 40.0))))
