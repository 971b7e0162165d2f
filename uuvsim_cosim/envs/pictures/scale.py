"""Scale of a picture: the visible part of the world, which changes smoothly between frames."""

from __future__ import annotations

import numpy as np

from uuvsim_cosim.envs.pictures.canvas_coverage import Floats

__all__ = ["Extent", "label", "nice_step", "ticks"]

APPROACH = 0.12  # share of the way to the wanted edge, a frame
SLACK = 0.2  # free room around what must be seen, as a share of its span


class Extent:
    """A box in some axes that follows points: holds still while they are well inside.

    It grows slowly before a point reaches the edge, at once where one is outside, and shrinks
    slowly when less than 40 % of it is used.
    """

    def __init__(self, least_span: float) -> None:
        self.least_span = least_span
        self._low: Floats | None = None
        self._high: Floats | None = None

    def forget(self) -> None:
        """Fit anew at the next call."""
        self._low = self._high = None

    def follow(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the lowest and greatest values shown, for points (n, axes), n >= 1."""
        low, high = points.min(axis=0), points.max(axis=0)
        margin = np.maximum(SLACK * (high - low), 0.5 * (self.least_span - (high - low)))
        margin = np.maximum(margin, 0.1 * (high - low).max())
        wanted_low, wanted_high = low - margin, high + margin
        if self._low is None or self._high is None:
            self._low, self._high = wanted_low, wanted_high
            return self._low, self._high
        span = self._high - self._low
        near = (low < self._low + 0.06 * span) | (high > self._high - 0.06 * span)
        loose = (high - low + 2.0 * margin) < 0.4 * span
        moves = (near | loose) * APPROACH
        self._low = np.minimum(self._low + moves * (wanted_low - self._low), low - 0.02 * span)
        self._high = np.maximum(self._high + moves * (wanted_high - self._high), high + 0.02 * span)
        return self._low, self._high


def nice_step(at_least: float) -> float:
    """Return the smallest of 1, 2, 5 times a power of ten that is not below `at_least` (> 0)."""
    power = 10.0 ** np.floor(np.log10(at_least))
    factor = next(f for f in (1.0, 2.0, 5.0, 10.0) if f * power >= at_least * (1.0 - 1e-9))
    return float(factor * power)


def ticks(low: float, high: float, step: float) -> Floats:
    """Return the multiples of `step` from `low` to `high`."""
    slack = 1e-9 * step
    return np.arange(np.ceil((low - slack) / step), np.floor((high + slack) / step) + 1.0) * step


def label(value: float, step: float) -> str:
    """Write a tick's value with as many decimals as its step needs."""
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return f"{value + 0.0:.{decimals}f}"
