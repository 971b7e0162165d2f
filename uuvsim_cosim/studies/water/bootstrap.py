"""Block bootstrap of prediction errors: RMS with interval, and the ratio of two with a verdict.

Errors of neighbouring windows are correlated. Blocks of consecutive windows are therefore drawn
instead of windows, with replacement (Künsch 1989); blocks do not overlap and do not span two runs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEAST_BLOCKS", "Measured", "compare", "root_mean_square"]

Array = NDArray[np.float64]
LEAST_BLOCKS = 8  # fewer do not carry an interval
_RESAMPLES = 2000


@dataclass(frozen=True)
class Measured:
    """A figure with its 95 % interval; an interval of too few blocks is NaN."""

    value: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """Verdict on a ratio of errors to those of another: its interval must carry it."""
        if self.high < 1.0:
            return "better"
        return "worse" if self.low > 1.0 else "cannot be decided"


def root_mean_square(errors: Array, blocks: NDArray[np.int64]) -> Measured:
    """Return the RMS of errors (n,) whose blocks are numbered (n,)."""
    squares, counts = _sums(errors, blocks)
    drawn = _draws(len(counts))
    value = float(np.sqrt(squares.sum() / counts.sum()))
    return _interval(value, np.sqrt(squares[drawn].sum(axis=1) / counts[drawn].sum(axis=1)), counts)


def compare(errors: Array, others: Array, blocks: NDArray[np.int64]) -> Measured:
    """Return the RMS of errors over that of others (n,), of the same windows."""
    one, counts = _sums(errors, blocks)
    other, _ = _sums(others, blocks)
    drawn = _draws(len(counts))
    value = float(np.sqrt(one.sum() / other.sum()))
    with np.errstate(divide="ignore", invalid="ignore"):
        return _interval(value, np.sqrt(one[drawn].sum(axis=1) / other[drawn].sum(axis=1)), counts)


def _sums(errors: Array, blocks: NDArray[np.int64]) -> tuple[Array, Array]:
    _, place = np.unique(blocks, return_inverse=True)
    # A model that diverges has errors beyond any number: limited, so that their squares are finite.
    limited = np.clip(np.nan_to_num(errors, nan=1e6), -1e6, 1e6)
    counts = np.bincount(place).astype(np.float64)
    return np.bincount(place, limited**2).astype(np.float64), counts


def _draws(blocks: int) -> NDArray[np.int64]:
    return np.random.default_rng(0).integers(0, blocks, (_RESAMPLES, blocks))


def _interval(value: float, resampled: Array, counts: Array) -> Measured:
    if len(counts) < LEAST_BLOCKS:
        return Measured(value, float("nan"), float("nan"))
    low, high = np.quantile(resampled, [0.025, 0.975])
    return Measured(value, float(low), float(high))
