"""Added mass of an ellipsoid in unbounded, inviscid water, by Lamb's integrals.

Lamb (1932), Hydrodynamics, 6th ed., arts. 114 and 115: with semi-axes a, b, c and
A_i = a b c ∫_0^∞ ds / ((a_i² + s) sqrt((a² + s)(b² + s)(c² + s))),   k_i = A_i / (2 - A_i).
"""

from __future__ import annotations

from math import pi

__all__ = ["added_mass"]


def added_mass(a: float, b: float, c: float, rho: float) -> list[float]:
    """Return the six diagonal elements [kg, kg.m2] for semi-axes a, b, c [m] and rho [kg/m3]."""
    from scipy.integrate import quad

    axes = (a, b, c)

    def integrand(s: float, i: int) -> float:
        root = float(((a * a + s) * (b * b + s) * (c * c + s)) ** 0.5)
        return a * b * c / ((axes[i] ** 2 + s) * root)

    scale = (a * b * c) ** (2 / 3)
    A = [
        quad(lambda x, i=i: scale * integrand(scale * x, i), 0.0, float("inf"), epsabs=1e-12)[0]
        for i in range(3)
    ]
    mass = 4 / 3 * pi * rho * a * b * c
    linear = [mass * x / (2.0 - x) for x in A]
    angular = []
    for j, k in ((1, 2), (0, 2), (0, 1)):
        p, q = axes[j] ** 2, axes[k] ** 2
        if abs(p - q) < 1e-12 * (p + q):
            angular.append(0.0)
            continue
        bottom = 2.0 * (p - q) + (p + q) * (A[j] - A[k])
        angular.append(mass / 5 * (p - q) ** 2 * (A[k] - A[j]) / bottom)
    return [*linear, *angular]
