"""Functions with finite value and gradient where CasADi's are not finite; NaN stays NaN."""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.expression import Number

__all__ = ["abs_", "atan2_or", "clip", "norm", "safe_sqrt", "saturate", "smoothstep", "wrap"]

TINY = 1e-300


def safe_sqrt(x: Number) -> ca.SX:
    """Return sqrt(x) with gradient 0 instead of infinity at x = 0."""
    return ca.if_else(x > TINY, ca.sqrt(ca.if_else(x > TINY, x, 1.0)), 0.0 * x)


def norm(x: Number) -> ca.SX:
    """Return |x| of a vector, with gradient 0 at 0 (that of `casadi.norm_2` is NaN)."""
    return safe_sqrt(ca.sumsqr(x))


def abs_(x: Number) -> ca.SX:
    """Return |`x`|, a number or an SX.

    Example:

    >>> import casadi as ca
    >>> from uuvsim_cosim.models import abs_
    >>> abs_(ca.SX.sym("x"))
    SX(fabs(x))
    """
    return ca.fabs(x)


def clip(x: Number, low: Number | np.ndarray, high: Number | np.ndarray) -> ca.SX:
    """Return x held within [low, high]; NaN stays NaN (`casadi.fmin` swallows it)."""
    return ca.if_else(x > high, high, ca.if_else(x < low, low, x))


def saturate(x: Number, limit: Number) -> ca.SX:
    """Return `x` held within [-`limit`, `limit`]; NaN stays NaN.

    Example:

    >>> import casadi as ca
    >>> from uuvsim_cosim.models import saturate
    >>> x = ca.SX.sym("x")
    >>> f = ca.Function("f", [x], [saturate(x, 2.0)])
    >>> float(f(3.0)), float(f(-1.0))
    (2.0, -1.0)
    """
    return clip(x, -limit, limit)


def smoothstep(x: Number) -> ca.SX:
    """Return the C1 step from 0 at x = 0 to 1 at x = 1:  3 x² - 2 x³."""
    s = clip(x, 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def atan2_or(y: Number, x: Number, fallback: Number) -> ca.SX:
    """Return atan2(y, x), and `fallback` (with finite gradients) where x and y both vanish."""
    vanish = x * x + y * y <= 1e-24
    return ca.if_else(vanish, fallback, ca.atan2(y, ca.if_else(vanish, 1.0, x)))


TURN = 6.283185307179586


def wrap(angle: ca.SX) -> ca.SX:
    """Return the angle in [-pi, pi); its gradient is 1."""
    return angle - TURN * ca.floor((angle + 0.5 * TURN) / TURN)
