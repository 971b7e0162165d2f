"""Derives the polynomials of fmus/runtime: interpolation at Chebyshev's nodes, in 60 digits.

Run it to print the coefficients, rounded to float64, as C, and the error that they leave, relative
to the function that each serves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mpmath
from mpmath import mpf

__all__ = ["POLYNOMIALS", "Polynomial", "coefficients", "relative_error"]

Function = Callable[[mpf], mpf]
DIGITS = 60
TERMS = 160  # of each Taylor series, far beyond 60 digits on every interval


@dataclass(frozen=True)
class Polynomial:
    """One polynomial P(x) on [a, b], which approximates a Taylor series of x."""

    name: str
    claim: str
    taylor: Callable[[int], mpf]  # coefficient of x^i
    a: mpf
    b: mpf
    size: int
    weight: Function  # error of P times this is the relative error of the function served


def _binomial(i: int) -> mpf:
    """Return the coefficient of x^2i in the derivative of asin: (2i)! / (4^i i!^2)."""
    return mpmath.binomial(2 * i, i) / mpf(4) ** i


def _polynomials() -> Iterator[Polynomial]:
    factorial, sqrt = mpmath.factorial, mpmath.sqrt
    slack = mpf("1.0001")  # rounding in the reduction may step over the interval's end
    half_ln2 = mpmath.log(2) / 2 * slack
    eighth = (mpmath.pi / 4) ** 2 * slack
    s_max = (sqrt(2) - 1) / (sqrt(2) + 1)
    yield Polynomial(
        "exp", "(exp(r) - 1 - r) / r^2", lambda i: 1 / factorial(i + 2),
        -half_ln2, half_ln2, 12, lambda r: r * r / mpmath.exp(r),
    )  # fmt: skip
    yield Polynomial(
        "log", "((2 atanh(s) - 2 s) / s^3 - 2/3) / s^2 of s^2", lambda i: mpf(2) / (2 * i + 5),
        mpf(0), s_max**2 * slack, 8, lambda z: z * z / 2,
    )  # fmt: skip
    yield Polynomial(
        "sin", "(sin(r) - r) / r^3 of r^2", lambda i: (-1) ** (i + 1) / factorial(2 * i + 3),
        mpf(0), eighth, 7, lambda z: z,
    )  # fmt: skip
    yield Polynomial(
        "cos", "(cos(r) - 1 + r^2/2) / r^4 of r^2", lambda i: (-1) ** i / factorial(2 * i + 4),
        mpf(0), eighth, 6, lambda z: z * z / mpmath.cos(sqrt(z)),
    )  # fmt: skip
    yield Polynomial(
        "asin", "(asin(x) - x) / x^3 of x^2", lambda i: _binomial(i + 1) / (2 * i + 3),
        mpf(0), mpf("0.25"), 13, lambda z: z,
    )  # fmt: skip
    yield Polynomial(
        "atan", "(atan(t) - t) / t^3 of t^2", lambda i: mpf(-1) ** (i + 1) / (2 * i + 3),
        mpf(0), mpf("0.35") ** 2, 10, lambda z: z,
    )  # fmt: skip
    yield Polynomial(
        "sinh", "(sinh(x) - x) / x^3 of x^2", lambda i: 1 / factorial(2 * i + 3),
        mpf(0), mpf(1), 8, lambda z: z,
    )  # fmt: skip
    yield Polynomial(
        "asinh", "(asinh(x) - x) / x^3 of x^2",
        lambda i: (-1) ** (i + 1) * _binomial(i + 1) / (2 * i + 3),
        mpf(0), mpf("0.25"), 12, lambda z: z,
    )  # fmt: skip


def _horner(ascending: Sequence[mpf], x: mpf) -> mpf:
    value = mpf(0)
    for c in reversed(ascending):
        value = value * x + c
    return value


def _series(p: Polynomial) -> Function:
    taylor = [p.taylor(i) for i in range(TERMS)]
    return lambda x: _horner(taylor, x)


def coefficients(p: Polynomial) -> list[float]:
    """Return the rounded coefficients, the constant first."""
    with mpmath.workdps(DIGITS):
        series, middle, half = _series(p), (p.a + p.b) / 2, (p.b - p.a) / 2
        angles = [mpmath.pi * (2 * k + 1) / (2 * p.size) for k in range(p.size)]
        nodes = [middle + half * mpmath.cos(angle) for angle in angles]
        powers = mpmath.matrix([[x**i for i in range(p.size)] for x in nodes])
        fit = mpmath.lu_solve(powers, mpmath.matrix([series(x) for x in nodes]))
        return [float(c) for c in fit]


def relative_error(p: Polynomial, c: list[float], points: int = 200) -> float:
    """Return the largest relative error of the function served, with coefficients `c`."""
    with mpmath.workdps(DIGITS):
        series, fit = _series(p), [mpf(x) for x in c]
        xs = [p.a + (p.b - p.a) * i / points for i in range(points + 1)]
        return float(max(abs((_horner(fit, x) - series(x)) * p.weight(x)) for x in xs))


with mpmath.workdps(DIGITS):
    POLYNOMIALS = tuple(_polynomials())

if __name__ == "__main__":
    for polynomial in POLYNOMIALS:
        c = coefficients(polynomial)
        e = mpmath.log(relative_error(polynomial, c), 2)
        print(f"/* {polynomial.claim}, within 2^{mpmath.nstr(e, 3)} */")
        print(f"static const uuv_real {polynomial.name}_c[{len(c)}] = {{")
        print("".join(f"    {x!r},\n" for x in c) + "};")
