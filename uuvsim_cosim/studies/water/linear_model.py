"""Linear model of a recording: ARX of second order in every judged signal, with a constant.

    y(k) = A_1 y(k - 1) + A_2 y(k - 2) + B_1 u(k - 1) + B_2 u(k - 2) + c

by least squares of the errors one sample ahead (Ljung 1999, section 4.2). A rigid body has two
states for each degree of freedom, and so has this model. Its sample time is that of several
multiples of the grid's step with the smallest errors 10 s ahead on the part that it was fitted to:
one sample ahead, noise hides slow motions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["LinearModel", "fit_linear_model"]

Array = NDArray[np.float64]
_SAMPLES = (0.1, 0.2, 0.25, 0.5, 1.0)  # s


@dataclass(frozen=True)
class LinearModel:
    """Coefficients (4 blocks and the constant, n_y) of samples `every` grid steps apart."""

    coefficients: Array
    every: int

    def predict(self, y: Array, u: Array, at: NDArray[np.int64], steps: int) -> Array:
        """Return predictions (len(at), n_y) `steps` grid steps after the points `at`.

        y (n_y, K + 1) are measurements at grid points, of which none after a point is used; u
        (n_u, K) are means over the steps.
        """
        r = self.every
        before, now = y[:, at - r].T, y[:, at].T
        past = _means(u, at - r, r)
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(steps // r):
                here = _means(u, at + k * r, r)
                row = np.concatenate([now, before, here, past, np.ones((len(at), 1))], axis=1)
                before, now, past = now, row @ self.coefficients, here
        return now


def fit_linear_model(
    y: Array, u: Array, runs: tuple[tuple[int, int], ...], h: float
) -> LinearModel:
    """Fit to measurements y (n_y, K + 1) and inputs u (n_u, K) within runs of the grid."""
    found: list[tuple[float, LinearModel]] = []
    for seconds in _SAMPLES:
        r = round(seconds / h)
        if r < 1 or abs(r * h - seconds) > 1e-6:
            continue
        at = _places(y, runs, 2 * r, r)
        if len(at) < 20:
            continue
        k = at - r
        rows = [y[:, k].T, y[:, k - r].T, _means(u, k, r), _means(u, k - r, r)]
        table = np.concatenate([*rows, np.ones((len(at), 1))], axis=1)
        model = LinearModel(np.linalg.lstsq(table, y[:, at].T, rcond=1e-10)[0], r)
        longest = max(b - a for a, b in runs) - 2 * r
        steps = min(round(10.0 / h), longest) // r * r
        ends = _places(y, runs, r + steps, r)
        if steps < r or not len(ends):
            continue
        here = ends - steps
        here = here[np.isfinite(y[:, here] + y[:, here - r]).all(axis=0)]
        error = model.predict(y, u, here, steps) - y[:, here + steps].T
        change = y[:, here + steps].T - y[:, here].T
        scale = np.maximum(np.nanmean(change**2, axis=0), 1e-12)
        worst = float(np.mean(np.nanmean(np.clip(error, -1e6, 1e6) ** 2, axis=0) / scale))
        found.append((worst, model))
    return min(found, key=lambda pair: pair[0])[1]


def _places(y: Array, runs: tuple[tuple[int, int], ...], before: int, r: int) -> NDArray[np.int64]:
    """Return points with measurements at them and at the two samples before, within a run."""
    every = [np.arange(a + before, b + 1) for a, b in runs if b - a >= before]
    at = np.concatenate(every) if every else np.zeros(0, np.int64)
    good = np.logical_and.reduce(np.isfinite(y), axis=0)
    seen = good[at] & good[at - r] & good[np.maximum(at - 2 * r, 0)]
    return np.asarray(at[seen], dtype=np.int64)


def _means(u: Array, first: NDArray[np.int64], r: int) -> Array:
    """Return the means (n, n_u) of inputs over r steps from each of `first`."""
    total = np.concatenate([np.zeros((len(u), 1)), np.cumsum(u, axis=1)], axis=1)
    return np.asarray(((total[:, first + r] - total[:, first]) / r).T, dtype=np.float64)
