"""Bootstrap intervals of means, deterministic for the same numbers; rank correlations."""

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
    """Return the mean and its percentile bootstrap interval (Efron 1979), 2000 resamples."""
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
    """Return Spearman's correlation within grid points, pooled; NaN if one of them never varies.

    Ranks are taken among the finite pairs of a point, so that differences between points do not
    count. `point` never falls.
    """
    from scipy.stats import rankdata

    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < 3:
        return float("nan")
    x, y, point = x[good], y[good], point[good]
    ends = np.flatnonzero(np.diff(point)) + 1
    a, b = [], []
    for p, q in zip(np.split(x, ends), np.split(y, ends), strict=True):
        middle = (len(p) + 1) / 2
        a.append(rankdata(p) - middle)
        b.append(rankdata(q) - middle)
    u, v = np.concatenate(a), np.concatenate(b)
    scale = float(np.sqrt((u @ u) * (v @ v)))
    return float(u @ v) / scale if scale > 0 else float("nan")
