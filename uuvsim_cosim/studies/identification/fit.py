"""Fit of parameters: steps of Gauss and Newton on windows of the recording, and the covariance.

sigma is estimated from the residuals of each signal, in a second and a third pass. A step is
shortened until the objective and the gaps between windows together become smaller. The covariance
is that of the last Gauss-Newton matrix with the states eliminated, increased by the correlation of
each residual with the one before it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.shooting import PRIOR, Point, Shooting
from uuvsim_cosim.studies.identification.signals import Grid

__all__ = ["AWAY", "FIRST", "LEAST", "Fit", "correlation_of_lag_one", "expected_information", "fit"]

Array = NDArray[np.float64]
# First and least values of sigma: N E D [m], angles, u v w [m/s], p q r [rad/s].
FIRST = np.array([0.05] * 3 + [0.02] * 3 + [0.02] * 3 + [0.02] * 3)
LEAST = np.array([1e-4] * 3 + [1e-5] * 3 + [1e-5] * 3 + [1e-5] * 3)
_ITERATIONS, _PASSES = 60, 3
# A step that decreases the objective by less ends the fit (one standard error is 0.5); in the
# passes before the last one, a share of the objective too.
_DECREASE, _COARSE = 1e-4, 1e-5
_GAP = 1e-3  # sum of the scaled gaps between windows
_SHORTEST = 1e-4  # share of a step below which nothing is gained


@dataclass(frozen=True)
class Fit:
    """theta (n_p,), its covariance, and sigma (12,) of each signal; sensitivity without states."""

    theta: Array
    covariance: Array
    sigma: Array  # of each signal's residuals
    correlation: Array  # of each signal's residuals with those one step before
    information: Array  # of theta, states eliminated
    x_0: Array
    samples: int
    iterations: int
    converged: bool
    status: str


AWAY = (
    "the fit diverged: no finite trajectory of the model follows the recording; expected a start "
    "nearer to the vehicle (another set), fewer --parameters, or a smaller --step"
)


def fit(
    box: GreyBox,
    grid: Grid,
    *,
    problem: Shooting | None = None,
    progress: Callable[[int, float], None] = lambda iteration, residual: None,
) -> Fit:
    """Fit the parameters of `box` to the measurements; raises InputInvalid if nothing converges.

    `problem` is that of `box` and `grid`, if it was made before. `progress` is called with the
    number of each iteration and the root mean square of the weighted residuals. An interrupt
    (Ctrl-C) ends the fit with the best values so far.
    """
    p = Shooting(box, grid) if problem is None else problem
    sigma = FIRST.copy()
    state = _State(p.at(p.theta, p.guess, sigma))
    if not state.point.is_finite:
        raise InputInvalid(AWAY)
    try:
        for _ in range(_PASSES):
            _descend(p, state, sigma, progress, coarse=True)
            before, sigma = sigma, _sigma(p, state.point)
            if np.all(np.abs(np.log(sigma / before)) < 0.05):
                break
        _descend(p, state, sigma, progress, coarse=False)
        sigma = _sigma(p, state.point)
    except KeyboardInterrupt:
        state.status = "interrupted"
        sigma = _sigma(p, state.point)
    point = p.at(state.point.theta, state.point.starts, sigma)
    rho = np.array([correlation_of_lag_one(values) for values in p.series(point.residual)])
    information = p.information(point, np.sqrt((1.0 - rho) / (1.0 + rho)))
    if not np.all(np.isfinite(information)):
        raise InputInvalid(AWAY)
    scaled = np.diag(p.scale)
    inverse = np.linalg.inv(information + PRIOR**2 * np.eye(p.n_p))
    return Fit(
        point.theta, scaled @ inverse @ scaled, sigma, rho,
        information / np.outer(p.scale, p.scale), point.starts[0], int(p.seen.sum()),
        state.iterations, state.status == "converged", state.status,
    )  # fmt: skip


def expected_information(problem: Shooting) -> Array:
    """Return the Fisher information of theta at its start, before a fit.

    The noise is that of predictions over a window with the start values, so that errors of the
    model count as noise.
    """
    point = problem.at(problem.theta, problem.guess, FIRST)
    sigma = _sigma(problem, point)
    point = problem.at(problem.theta, problem.guess, sigma)
    rho = np.array([correlation_of_lag_one(values) for values in problem.series(point.residual)])
    information = problem.information(point, np.sqrt((1.0 - rho) / (1.0 + rho)))
    return np.asarray(information / np.outer(problem.scale, problem.scale), dtype=np.float64)


@dataclass
class _State:
    """The best point so far, and how it was reached."""

    point: Point
    iterations: int = 0
    status: str = "interrupted"


def _descend(
    p: Shooting, state: _State, sigma: Array, progress: Callable[[int, float], None], coarse: bool
) -> None:
    """Step until neither the objective nor the gaps become smaller."""
    low, high = (np.array([getattr(f, end) for f in p.box.fitted]) for end in ("low", "high"))
    state.point = p.at(state.point.theta, state.point.starts, sigma)
    samples, penalty = max(int(p.seen.sum()), 1), 1.0
    for _ in range(_ITERATIONS):
        here = state.point
        d_theta, d_starts, slope, curvature = p.step(here, low, high)
        gaps = float(np.abs(here.gap).sum())
        if gaps > 0.0:  # enough that the step leads downhill (Nocedal and Wright, 18.36)
            penalty = max(2.0 * (slope + 0.5 * curvature) / gaps, 0.3 * penalty, 1.0)
        limit = (_COARSE if coarse else 1e-9) * here.objective + _DECREASE
        if abs(slope) < limit and gaps < _GAP:
            state.status = "converged"
            return
        share, merit = 1.0, here.objective + penalty * gaps
        while True:
            there = p.at(here.theta + share * d_theta, here.starts + share * d_starts, sigma)
            expected = 1e-4 * share * (slope - penalty * gaps)
            if there.is_finite:
                found = there.objective + penalty * float(np.abs(there.gap).sum())
                if found <= merit + expected:
                    break
            share *= 0.5
            if share < _SHORTEST:
                state.status = "no step makes the residuals smaller"
                return
        state.point = there
        state.iterations += 1
        progress(state.iterations, float(np.sqrt(2.0 * there.objective / samples)))
    state.status = f"{_ITERATIONS} iterations were not enough"


def _sigma(p: Shooting, point: Point) -> Array:
    good = [values[np.isfinite(values)] for values in p.series(point.residual)]
    return np.array(
        [max(float(np.sqrt(np.mean(r**2))), least) if len(r) else 1.0
         for r, least in zip(good, LEAST, strict=True)]
    )  # fmt: skip


def correlation_of_lag_one(values: Array) -> float:
    """Return the correlation of residuals with those of the step before, limited to 0 … 0.98."""
    a, b = values[:-1], values[1:]
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 8:
        return 0.0
    power = float(np.mean(a[both] ** 2))
    return float(np.clip(np.mean(a[both] * b[both]) / power, 0.0, 0.98)) if power > 0 else 0.0
