"""Fit of parameters: steps of Gauss and Newton on windows of the recording, and the covariance.

sigma is estimated from the residuals of each signal, in a second and a third pass, and so is their
correlation if they are autoregressive. A step is shortened until the objective and the gaps between
windows together become smaller. If the steps of integration move a parameter by more than half of
its standard error, they are halved. The covariance is that of the last Gauss-Newton matrix with the
states eliminated. If the residuals are not white, it is widened to the sandwich covariance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.residuals import (
    Whiteness,
    correlation_of_lag_one,
    long_run_covariance,
    whiteness,
)
from uuvsim_cosim.studies.identification.shooting import PRIOR, Noise, Point, Shooting
from uuvsim_cosim.studies.identification.signals import Grid

__all__ = ["AWAY", "FIRST", "LEAST", "Fit", "expected_information", "fit"]

Array = NDArray[np.float64]
# First and least values of sigma: N E D [m], angles, u v w [m/s], p q r [rad/s].
FIRST = np.array([0.05] * 3 + [0.02] * 3 + [0.02] * 3 + [0.02] * 3)
LEAST = np.array([1e-4] * 3 + [1e-5] * 3 + [1e-5] * 3 + [1e-5] * 3)
_ITERATIONS, _PASSES = 60, 3
_PASSES_COLOURED = 8  # sigma and rho depend on each other
# A step that decreases the objective by less ends the fit (one standard error is 0.5); in the
# passes before the last one, a share of the objective too.
_DECREASE, _COARSE = 1e-4, 1e-5
_GAP = 1e-3  # sum of the scaled gaps between windows
# Steps of integration are halved if they move a parameter by a larger share of its standard error,
# and then again until they hardly move it.
_INTEGRATED = (0.5, 0.05, 0.05)
_SHORTEST = 1e-4  # share of a step below which nothing is gained


@dataclass(frozen=True)
class Fit:
    """theta (n_p,), its covariance, and sigma (12,) of each signal; sensitivity without states."""

    theta: Array
    covariance: Array
    sigma: Array  # of each signal's residuals
    correlation: Array  # of each signal's residuals with those one step before
    information: Array  # of theta, states eliminated: as far as the residuals are independent
    x_0: Array
    samples: int
    iterations: int
    converged: bool
    status: str
    widened: Array  # factors of standard errors, because residuals are not white
    whiteness: tuple[Whiteness, ...] = ()  # of each signal with noise
    point: Point | None = None  # where it ended
    noise: Noise | None = None  # its weights


AWAY = (
    "the fit diverged: no finite trajectory of the model follows the recording; expected a start "
    "nearer to the vehicle (another set), fewer --parameters, or a smaller --step"
)


def fit(
    box: GreyBox,
    grid: Grid,
    *,
    problem: Shooting | None = None,
    residuals: str = "robust",
    progress: Callable[[int, float], None] = lambda iteration, residual: None,
) -> Fit:
    """Fit the parameters of `box` to the measurements; raises InputInvalid if nothing converges.

    `problem` is that of `box` and `grid`, if it was made before. `residuals` is one of RESIDUALS
    (assumptions.py). `progress` is called with the number of each iteration and the root mean
    square of the weighted residuals. An interrupt (Ctrl-C) ends the fit with the best values so
    far.
    """
    p = Shooting(box, grid) if problem is None else problem
    coloured = residuals == "ar1"
    noise = Noise(FIRST.copy(), np.zeros(12))
    state = _State(p.at(p.theta, p.guess, noise))
    if not state.point.is_finite:
        raise InputInvalid(AWAY)
    try:
        for _ in range(_PASSES_COLOURED if coloured else _PASSES):
            _descend(p, state, noise, progress, coarse=True)
            before, noise = noise, _noise(p, state.point, coloured)
            same = np.abs(np.log(noise.sigma / before.sigma)) < 0.05
            if np.all(same & (np.abs(noise.rho - before.rho) < 0.01)):
                break
        _descend(p, state, noise, progress, coarse=False)
        noise = _noise(p, state.point, coloured)
        for limit in _INTEGRATED:
            point = p.at(state.point.theta, state.point.starts, noise)
            moved = p.moved_by_integration(point, noise)
            error = np.sqrt(np.diag(np.linalg.inv(_with_prior(p.information(point)))))
            if not np.any(np.abs(moved) > limit * error):
                break
            p.windows.pieces *= 2
            _descend(p, state, noise, progress, coarse=False)
            noise = _noise(p, state.point, coloured)
    except np.linalg.LinAlgError:
        raise InputInvalid(AWAY) from None
    except KeyboardInterrupt:
        state.status = "interrupted"
        noise = _noise(p, state.point, coloured)
    point = p.at(state.point.theta, state.point.starts, noise)
    information = p.information(point)
    if not np.all(np.isfinite(information)):
        raise InputInvalid(AWAY)
    inverse = np.asarray(np.linalg.inv(_with_prior(information)), dtype=np.float64)
    tested = tuple(
        whiteness(j, values)
        for j, values in enumerate(p.series(p.innovations(point, noise)))
        if j in p.measured and noise.sigma[j] > LEAST[j]  # smaller ones are of the solution
    )
    factor = np.ones(p.n_p)
    if residuals != "white" and not all(t.holds for t in tested):
        factor = _widening(p, point, noise, inverse)
    scaled = np.diag(p.scale * factor)
    size = p.scale * factor
    plain = list(p.series(point.residual))
    return Fit(
        point.theta, scaled @ inverse @ scaled, np.array([_rms(r) for r in plain]).clip(LEAST),
        np.array([correlation_of_lag_one(r) for r in plain]), information / np.outer(size, size),
        point.starts[0], int(p.seen.sum()), state.iterations, state.status == "converged",
        state.status, factor, tested, point, noise,
    )  # fmt: skip


def _widening(p: Shooting, point: Point, noise: Noise, inverse: Array) -> Array:
    """Return factors (n_p,) of standard errors, because residuals are correlated.

    They are the larger ones of the sandwich covariance, which is too narrow for few independent
    residuals, and of residuals that are autoregressive, with slow sensitivities.
    """
    meat = sum(long_run_covariance(s) for s in p.scores(point))
    of_scores = np.diag(inverse @ meat @ inverse)
    rho = np.array([correlation_of_lag_one(r) for r in p.series(p.innovations(point, noise))])
    slower = p.information(point, np.sqrt((1.0 - rho) / (1.0 + rho)))
    of_signals = np.diag(np.linalg.inv(_with_prior(slower)))
    plain = np.diag(inverse)
    return np.asarray(np.sqrt(np.maximum.reduce([of_scores, of_signals, plain]) / plain))


def _with_prior(information: Array) -> Array:
    return information + PRIOR**2 * np.eye(len(information))


def expected_information(problem: Shooting) -> Array:
    """Return the Fisher information of theta at its start, before a fit.

    The noise is that of predictions over a window with the start values, so that errors of the
    model count as noise.
    """
    point = problem.at(problem.theta, problem.guess, Noise(FIRST, np.zeros(12)))
    noise = _noise(problem, point, coloured=False)
    point = problem.at(problem.theta, problem.guess, noise)
    # Within windows: each has a start of its own here.
    rho = np.array([correlation_of_lag_one(r.ravel()) for r in np.moveaxis(point.residual, 2, 0)])
    information = problem.information(point, np.sqrt((1.0 - rho) / (1.0 + rho)))
    return np.asarray(information / np.outer(problem.scale, problem.scale), dtype=np.float64)


@dataclass
class _State:
    """The best point so far, and how it was reached."""

    point: Point
    iterations: int = 0
    status: str = "interrupted"


def _descend(
    p: Shooting, state: _State, noise: Noise, progress: Callable[[int, float], None], coarse: bool
) -> None:
    """Step until neither the objective nor the gaps become smaller."""
    low, high = (np.array([getattr(f, end) for f in p.box.fitted]) for end in ("low", "high"))
    state.point = p.at(state.point.theta, state.point.starts, noise)
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
            there = p.at(here.theta + share * d_theta, here.starts + share * d_starts, noise)
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
    state.status = f"the last {_ITERATIONS} of them did not converge"


def _noise(p: Shooting, point: Point, coloured: bool) -> Noise:
    """Return sigma of the residuals; if they are autoregressive, that of innovations, and rho."""
    every = list(p.series(point.residual))
    rho = np.array([correlation_of_lag_one(r) if coloured else 0.0 for r in every])
    sigma = np.array([_rms(r) for r in every]) * np.sqrt(1.0 - rho**2)
    return Noise(np.where(np.isin(np.arange(12), p.measured), np.maximum(sigma, LEAST), 1.0), rho)


def _rms(values: Array) -> float:
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if len(good) else 1.0
