"""How sure a mean is: percentile intervals by the bootstrap, the same for the same numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Interval", "interval", "rank_correlation"]

Array = NDArray[np.float64]
RESAMPLES = 2000
LEVEL = 0.95
SEED = 20260101


@dataclass(frozen=True)
class Interval:
    """Mean of the finite numbers with its 95 % interval; NaN where there are too few."""

    n: int
    mean: float
    low: float
    high: float
    std: float
    median: float


def interval(values: Sequence[float] | Array) -> Interval:
    """Give the mean and its percentile bootstrap interval (Efron 1979), 2000 resamples."""
    x = np.sort(np.asarray(values, dtype=float))
    x = x[np.isfinite(x)]
    n = len(x)
    nan = float("nan")
    if n == 0:
        return Interval(0, nan, nan, nan, nan, nan)
    mean, std, median = float(x.mean()), float(x.std()), float(np.median(x))
    if n == 1:
        return Interval(1, mean, nan, nan, nan, median)
    rng = np.random.default_rng(SEED)
    size = max(1, min(RESAMPLES, 4_000_000 // n))
    means = np.concatenate(
        [
            x[rng.integers(0, n, (min(size, RESAMPLES - k), n))].mean(axis=1)
            for k in range(0, RESAMPLES, size)
        ]
    )
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(n, mean, float(low), float(high), std, median)


def rank_correlation(x: Array, y: Array, point: NDArray[np.int64]) -> float:
    """Give Spearman's correlation within grid points, pooled; NaN if one of them never varies.

    Ranks are taken among the finite pairs of a point, so that differences between points do not
    count.
    """
    from scipy.stats import rankdata

    good = np.isfinite(x) & np.isfinite(y)
    a, b = [], []
    for p in np.unique(point[good]):
        here = good & (point == p)
        middle = (int(here.sum()) + 1) / 2
        a.append(rankdata(x[here]) - middle)
        b.append(rankdata(y[here]) - middle)
    if good.sum() < 3:
        return float("nan")
    u, v = np.concatenate(a), np.concatenate(b)
    scale = float(np.sqrt((u @ u) * (v @ v)))
    return float(u @ v) / scale if scale > 0 else float("nan")
