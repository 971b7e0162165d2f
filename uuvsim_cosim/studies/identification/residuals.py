"""Residuals of a fit: whether they are white, and the covariance of correlated scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.identification.assumptions import MEASURED

__all__ = ["Whiteness", "correlation_of_lag_one", "long_run_covariance", "warning_of", "whiteness"]

Array = NDArray[np.float64]
_LAGS = 20
_LEVEL = 0.01 / 12  # of a test, so that one of 12 signals fails by chance in one of 100 fits
_SLIGHT = 0.1  # correlations below it have little effect on intervals
_PERSISTENT = 0.97  # largest correlation of successive scores that is modelled


@dataclass(frozen=True)
class Whiteness:
    """Test of Ljung and Box (1978) on the residuals of a signal: Q against a limit of chi-squared.

    `largest` is the largest correlation of the tested lags, at `lag` [samples].
    """

    signal: str
    Q: float
    limit: float
    lags: int
    largest: float
    lag: int

    @property
    def holds(self) -> bool:
        """Whether the residuals are white, or so nearly that intervals hold."""
        return self.limit >= self.Q or abs(self.largest) < _SLIGHT


def whiteness(signal: int, values: Array) -> Whiteness:
    """Test the residuals (n,) of a signal over time; they may be NaN."""
    from scipy.special import chdtri

    good = np.isfinite(values)
    at = np.flatnonzero(good)
    stride = max(1, int(np.median(np.diff(at)))) if len(at) > 1 else 1
    r = np.nan_to_num(values)
    power = float(np.sum(r**2)) / max(len(at), 1)
    Q, found = 0.0, []
    for lag in stride * np.arange(1, min(_LAGS, len(at) // 5) + 1):
        pairs = int(np.sum(good[lag:] & good[:-lag]))
        if pairs < 8 or power == 0.0:
            continue
        rho = float(np.sum(r[lag:] * r[:-lag])) / (pairs * power)
        # Its variance is (n - lag) / (n (n + 2)) if all n are there.
        Q += pairs * rho**2 * (len(at) + 2) / len(at)
        found.append((rho, int(lag)))
    largest, at_lag = max(found, key=lambda pair: abs(pair[0]), default=(0.0, 0))
    limit = float(chdtri(len(found), _LEVEL)) if found else float("inf")
    return Whiteness(MEASURED[signal], Q, limit, len(found), largest, at_lag)


def warning_of(
    tested: Sequence[Whiteness],
    widened: Array,
    residuals: str,
    improvements: Callable[[], Sequence[str]],
) -> str | None:
    """Return a warning if residuals are not white: the test with its figure, and what to do.

    `improvements` computes what would lower the sum of squares, and is called only then.
    """
    failed = sorted((t for t in tested if not t.holds), key=lambda t: t.limit / t.Q)
    if not failed:
        return None
    worst = failed[0]
    names = ", ".join(t.signal for t in failed)
    least, most = (f"{v:.2g}" for v in (np.min(widened), np.max(widened)))
    effect = (
        "the intervals are too narrow"
        if residuals == "white"
        else f"standard errors were multiplied by {least} to {most} (sandwich covariance)"
    )
    other = "" if residuals == "ar1" else ", or --residuals ar1"
    found = improvements()
    advice = (
        f"to a first estimate, {'; '.join(found)}"
        if found
        else f"try another --inputs, more --parameters{other}"
    )
    return (
        f"the residuals of {names} are not white: Ljung-Box Q = {worst.Q:.4g} of {worst.signal} "
        f"over {worst.lags} lags, and the limit is {worst.limit:.3g} (correlation "
        f"{worst.largest:.2f} at {worst.lag} {'step' if worst.lag == 1 else 'steps'}); {effect}, "
        f"and the numbers may be biased; {advice}"
    )


def correlation_of_lag_one(values: Array) -> float:
    """Return the correlation of residuals with those of the step before, limited to 0 … 0.98."""
    a, b = values[:-1], values[1:]
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 8:
        return 0.0
    power = float(np.mean(a[both] ** 2))
    return float(np.clip(np.mean(a[both] * b[both]) / power, 0.0, 0.98)) if power > 0 else 0.0


def long_run_covariance(scores: Array) -> Array:
    """Return the covariance (n_p, n_p) of the sum of correlated scores (n, n_p).

    Autocorrelation-consistent: each score is made nearly white by its own correlation of lag one
    (Andrews and Monahan 1992), the rest is summed with the weights of Parzen over the bandwidth of
    Andrews (1991, equations 6.2 and 6.4).
    """
    n, n_p = scores.shape
    if n < 8:
        return np.asarray(scores.T @ scores, dtype=np.float64)
    power = np.maximum(np.sum(scores[:-1] ** 2, axis=0), 1e-300)
    a = np.clip(np.sum(scores[1:] * scores[:-1], axis=0) / power, -_PERSISTENT, _PERSISTENT)
    rest = scores[1:] - a * scores[:-1]
    power = np.maximum(np.sum(rest[:-1] ** 2, axis=0), 1e-300)
    rho = np.clip(np.sum(rest[1:] * rest[:-1], axis=0) / power, -_PERSISTENT, _PERSISTENT)
    alpha = np.mean(4.0 * rho**2 / (1.0 - rho) ** 8) / np.mean(1.0 / (1.0 - rho) ** 4)
    bandwidth = min(2.6614 * (alpha * n) ** 0.2, n / 4.0)
    total = rest.T @ rest
    for lag in range(1, int(bandwidth) + 1):
        x = lag / bandwidth
        weight = 1.0 - 6.0 * x**2 + 6.0 * x**3 if x <= 0.5 else 2.0 * (1.0 - x) ** 3
        product = rest[lag:].T @ rest[:-lag]
        total += weight * (product + product.T)
    back = 1.0 / (1.0 - a)
    return np.asarray(total * np.outer(back, back) * n / max(n - n_p, 1), dtype=np.float64)
