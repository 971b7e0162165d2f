"""A sampled signal between its samples: smooth where it is smooth, broken where it breaks.

Samples of a smooth function are joined by a spline of fifth degree, whose error at ten samples
a radian is below 1e-7 of the amplitude. A jump (a change many times those beside it) ends a
piece: the new value holds from its own sample on. So does a kink, at the sample itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Signal"]

Array = NDArray[np.float64]
RATIO = 3.0
LEAST = 1e-6


class Signal:
    """A function of time through samples; beyond the last sample it holds the last value."""

    def __init__(self, t: Array, values: Array, held: bool = False) -> None:
        self.t = t
        self.values = values
        self._held = held or bool(np.all(values == values[0]))
        self._pieces = [] if self._held else _pieces(t, values)
        self._starts = np.array([t[a] for a, _ in self._pieces])

    def __call__(self, t: float) -> float:
        """Return the value at t; at a jump the new one."""
        if self._held or t >= self.t[-1]:
            i = int(np.searchsorted(self.t, t, side="right")) - 1
            return float(self.values[max(i, 0)])
        piece = int(np.searchsorted(self._starts, t, side="right")) - 1
        return float(self._pieces[max(piece, 0)][1](t))

    def at(self, t: Array) -> Array:
        """Return the values at many times at once."""
        if self._held:
            return self.values[np.maximum(np.searchsorted(self.t, t, side="right") - 1, 0)]
        values = np.full(len(t), float(self.values[-1]))
        piece = np.maximum(np.searchsorted(self._starts, t, side="right") - 1, 0)
        for i, (_, function) in enumerate(self._pieces):
            here = (piece == i) & (t < self.t[-1])
            values[here] = function(t[here])
        return values


def _pieces(t: Array, values: Array) -> list[tuple[int, Any]]:
    """Return (index of the first sample, function) of each piece."""
    from scipy.interpolate import make_interp_spline

    jumps = _breaks(np.diff(values))  # between sample i and i + 1
    inner = [i for i in _breaks(np.diff(values, 2)) if not {i, i + 1} & jumps]
    kinks = {i + 1 for i in inner if not {i - 1, i + 2} & jumps}
    firsts = sorted({0, *(i + 1 for i in jumps), *kinks})
    pieces: list[tuple[int, Any]] = []
    for first, following in zip(firsts, [*firsts[1:], len(t)], strict=True):
        shared = following in kinks or following == len(t)
        last = min(following, len(t) - 1) if shared else following - 1
        t_piece, piece = t[first : last + 1], values[first : last + 1]
        if len(piece) == 1 or np.all(piece == piece[0]):
            pieces.append((first, lambda _, constant=piece[0]: constant))
        else:
            degree = min(5, len(piece) - 1)
            degree -= 1 - degree % 2
            pieces.append((first, make_interp_spline(t_piece, piece, k=degree)))
    return pieces


def _breaks(change: Array) -> set[int]:
    """Return the indices of changes many times those beside them."""
    if len(change) < 4:
        return set()
    size = np.abs(change)
    beside = np.maximum(np.append(size[1:], 0.0), np.append(0.0, size[:-1]))
    # With neighbours on one side only, an extremum nearby could look like a jump: ask more.
    beside[0], beside[-1] = size[1:4].max(), size[-4:-1].max()
    return {int(i) for i in np.flatnonzero((size > RATIO * beside) & (size > LEAST * size.max()))}
