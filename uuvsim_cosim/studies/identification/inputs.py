"""Inputs between the samples of a recording, and their moments over the steps of a grid.

A sampled input is held until the next sample, a straight line between samples, or a cubic spline
through them. On the grid of a fit it is a straight line over each step, with the same impulse and
first moment. A delay moves the input; its derivatives by the delay are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["COURSES", "Curve", "Inputs"]

Array = NDArray[np.float64]
COURSES = ("held", "linear", "smooth")
_GAP = 3.5  # times the usual distance of samples: across a longer gap, smooth is linear


@final
class Curve:
    """A signal through samples (t, values) at rising times; constant before and after them.

    `course` is one of COURSES. Samples that are NaN are left out.
    """

    def __init__(self, t: Array, values: Array, course: str) -> None:
        from scipy.interpolate import PPoly

        self.t, self.values, self.course = t, values, course
        good = np.isfinite(values)
        if not good.any():
            raise InputInvalid("a signal that drives the vehicle holds no number", "some")
        at, v = t[good], values[good]
        self.center = float(np.mean(v))  # taken off, so that integrals stay small
        v = v - self.center
        inner = np.zeros((4, len(at) - 1))
        inner[3] = v[:-1]
        if course != "held" and len(at) > 1:
            distance = np.diff(at)
            inner[2] = np.diff(v) / distance
            if course == "smooth" and len(at) > 3:
                usual = distance <= _GAP * np.median(distance)
                inner[:, usual] = _spline(at, v)[:, usual]
        ends = np.zeros((4, 2))
        ends[3] = v[[0, -1]]
        pieces = np.hstack([ends[:, :1], inner, ends[:, 1:]])
        breaks = np.concatenate([[at[0] - 1.0], at, [at[-1] + 1.0]])
        self._value = PPoly(pieces, breaks)
        self._once, self._twice = self._value.antiderivative(1), self._value.antiderivative(2)

    def scaled(self, factor: float, offset: float) -> Curve:
        """Return factor times the signal plus offset."""
        if (factor, offset) == (1.0, 0.0):
            return self
        return Curve(self.t, factor * self.values + offset, self.course)

    def at(self, times: Array) -> Array:
        """Return the values at `times`; at a jump, those after it."""
        return np.asarray(self._value(times) + self.center, dtype=np.float64)

    def moments(self, edges: Array) -> Array:
        """Return mean and change (2, K) over the steps between `edges` (K + 1,).

        The change is that of the line with the same mean and first moment over the step.
        """
        h = np.diff(edges)
        once, twice = self._once(edges), self._twice(edges)
        mean = np.diff(once) / h
        first = 0.5 * h * (once[:-1] + once[1:]) - np.diff(twice)  # about the middle of the step
        return np.stack([mean + self.center, 12.0 / h**2 * first])

    def rates(self, edges: Array) -> Array:
        """Return the derivatives (2, K) of the moments if the signal is delayed."""
        h, value = np.diff(edges), self._value(edges)
        mean = np.diff(self._once(edges)) / h
        rise = -np.diff(value) / h
        return np.stack([rise, -6.0 / h * (value[:-1] + value[1:] - 2.0 * mean)])


def _spline(t: Array, values: Array) -> Array:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, values).c, dtype=np.float64)


@dataclass(frozen=True)
class Inputs:
    """Curves of the feeds of a model on the edges of a grid, each with a known delay [s].

    `delayed` are the feeds that an unknown delay moves, too.
    """

    edges: Array
    curves: tuple[Curve, ...]
    delays: tuple[float, ...]
    delayed: tuple[int, ...] = ()

    def at(self, delay: float = 0.0) -> Array:
        """Return the means of all feeds over the steps, then their changes along them, (2 n, K).

        With an unknown delay, the feeds are followed by the derivatives of the delayed ones.
        """
        moments, rates = [], []
        for k, (curve, known) in enumerate(zip(self.curves, self.delays, strict=True)):
            moved = k in self.delayed
            edges = self.edges - known - (delay if moved else 0.0)
            moments.append(curve.moments(edges))
            if moved:
                rates.append(curve.rates(edges))
        every = np.array([*moments, *rates]).reshape(-1, 2, len(self.edges) - 1)
        return np.concatenate([every[:, 0], every[:, 1]])
