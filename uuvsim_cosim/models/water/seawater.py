"""Sea water: density (EOS-80), hydrostatic pressure, gravity by latitude, speed of sound.

Temperature T [degC], practical salinity S [1], gauge pressure p [Pa], depth h [m]; every function
takes numbers or CasADi expressions.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.safe_math import safe_sqrt

__all__ = [
    "bulk_modulus",
    "density",
    "depth_of_pressure",
    "gravity",
    "pressure_at_depth",
    "sound_speed",
]

BAR = 1e5


def _polynomial(x: Number, *coefficients: float) -> Number:
    result: Number = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        result = result * x + c
    return result


def _root(S: Number) -> Number:
    return safe_sqrt(S) if isinstance(S, ca.SX) else S**0.5


def _density_at_surface(S: Number, T: Number) -> Number:
    return (
        _polynomial(
            T, 999.842594, 6.793952e-2, -9.095290e-3, 1.001685e-4, -1.120083e-6, 6.536332e-9
        )
        + S * _polynomial(T, 8.24493e-1, -4.0899e-3, 7.6438e-5, -8.2467e-7, 5.3875e-9)
        + S * _root(S) * _polynomial(T, -5.72466e-3, 1.0227e-4, -1.6546e-6)
        + 4.8314e-4 * S * S
    )


def bulk_modulus(S: Number, T: Number, p: Number = 0.0) -> Number:
    """Return the secant bulk modulus K [Pa]; EOS-80, UNESCO Technical Papers 38 (1981)."""
    b = p / BAR
    S15 = S * _root(S)
    K = (
        _polynomial(T, 19652.21, 148.4206, -2.327105, 1.360477e-2, -5.155288e-5)
        + S * _polynomial(T, 54.6746, -0.603459, 1.09987e-2, -6.1670e-5)
        + S15 * _polynomial(T, 7.944e-2, 1.6483e-2, -5.3009e-4)
    )
    A = (
        _polynomial(T, 3.239908, 1.43713e-3, 1.16092e-4, -5.77905e-7)
        + S * _polynomial(T, 2.2838e-3, -1.0981e-5, -1.6078e-6)
        + 1.91075e-4 * S15
    )
    B = _polynomial(T, 8.50935e-5, -6.12293e-6, 5.2787e-8) + S * _polynomial(
        T, -9.9348e-7, 2.0816e-8, 9.1697e-10
    )
    return (K + (A + B * b) * b) * BAR


def density(S: Number, T: Number, p: Number = 0.0) -> Number:
    """Return rho [kg/m3] by EOS-80:  rho(S, T, p) = rho(S, T, 0) / (1 - p / K(S, T, p))."""
    return _density_at_surface(S, T) / (1.0 - p / bulk_modulus(S, T, p))


def pressure_at_depth(h: Number, S: Number, T: Number, g: Number) -> Number:
    """Return the gauge pressure [Pa] at depth h of a column of uniform S and T.

    dp/dh = rho g with rho = rho_0 / (1 - p / K) and K held at its value at the surface has
    the closed form  p = K (1 - sqrt(1 - 2 rho_0 g h / K)).  Against the full EOS-80, that K
    grows with p costs 1e-5 of p at 1000 m.
    """
    K = bulk_modulus(S, T)
    x = 1.0 - 2.0 * _density_at_surface(S, T) * g * h / K
    return K * (1.0 - (safe_sqrt(x) if isinstance(x, ca.SX) else x**0.5))


def depth_of_pressure(p: Number, S: Number, T: Number, g: Number) -> Number:
    """Return the depth [m] of a gauge pressure: the exact inverse of `pressure_at_depth`."""
    return p * (1.0 - 0.5 * p / bulk_modulus(S, T)) / (_density_at_surface(S, T) * g)


def gravity(latitude: ca.SX) -> Number:
    """Return g [m/s2] at sea level at a latitude [rad]; UNESCO Technical Papers 44 (1983)."""
    s2 = ca.sin(latitude) ** 2
    return 9.780318 * (1.0 + (5.2788e-3 + 2.36e-5 * s2) * s2)


def sound_speed(T: Number, S: Number, D: ca.SX) -> Number:
    """Return c [m/s] at depth D; Mackenzie (1981), J. Acoust. Soc. Am. 70(3), 807-812.

    Holds for 2 to 30 degC, salinity 25 to 40, 0 to 8000 m.
    """
    return (
        _polynomial(T, 1448.96, 4.591, -5.304e-2, 2.374e-4)
        + 1.340 * (S - 35.0)
        + 1.630e-2 * D
        + 1.675e-7 * D * D
        - 1.025e-2 * T * (S - 35.0)
        - 7.139e-13 * T * D**3
    )
