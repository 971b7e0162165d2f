"""Test of whiteness, and the covariance of correlated scores, on series with known correlation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.studies.identification.residuals import (
    long_run_covariance,
    warning_of,
    whiteness,
)

Array = NDArray[np.float64]


def series(seed: int, n: int, rho: float) -> Array:
    e = np.random.default_rng(seed).normal(size=n)
    for k in range(1, n):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * e[k]
    return e


def test_white_residuals_hold_and_correlated_ones_do_not() -> None:
    assert sum(whiteness(6, series(s, 400, 0.0)).holds for s in range(100)) >= 99
    for seed in range(20):
        found = whiteness(6, series(seed, 400, 0.5))
        assert not found.holds
        assert (found.signal, found.lag) == ("u", 1)
        assert found.largest == pytest.approx(0.5, abs=0.2)


def test_q_of_white_residuals_is_as_large_as_the_number_of_lags() -> None:
    Q = [whiteness(0, series(s, 300, 0.0)).Q for s in range(200)]
    assert np.mean(Q) == pytest.approx(20.0, abs=1.5)  # chi-squared with 20 degrees of freedom
    assert np.std(Q) == pytest.approx(np.sqrt(40.0), rel=0.25)


def test_samples_between_gaps_are_tested_at_their_own_distance() -> None:
    sparse = np.full(1200, np.nan)
    sparse[::3] = series(1, 400, 0.6)
    found = whiteness(0, sparse)
    assert (found.holds, found.lag, found.lags) == (False, 3, 20)
    assert whiteness(0, np.full(100, np.nan)).holds


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_covariance_of_a_sum_is_that_of_its_autocorrelation(rho: float) -> None:
    n = 4000
    found = [long_run_covariance(series(s, n, rho)[:, None])[0, 0] / n for s in range(8)]
    assert np.mean(found) == pytest.approx((1 + rho) / (1 - rho), rel=0.15)


def test_a_warning_names_test_figure_and_remedy() -> None:
    bad, good = whiteness(6, series(1, 400, 0.5)), whiteness(7, series(1, 400, 0.0))
    asked: list[int] = []

    def improvements() -> list[str]:
        asked.append(1)
        return ["--unknown delay lowers the sum of squares by 40%"]

    assert warning_of([good], np.ones(2), "robust", improvements) is None
    assert not asked  # it takes time, and is needed for a warning only
    text = warning_of([good, bad], np.array([1.2, 2.0]), "robust", improvements) or ""
    assert text.startswith(f"the residuals of u are not white: Ljung-Box Q = {bad.Q:.4g} of u over")
    assert "multiplied by 1.2 to 2 " in text
    assert "--unknown delay" in text
    plain = warning_of([bad], np.ones(2), "white", list) or ""
    assert "intervals are too narrow" in plain
    assert "--residuals ar1" in plain
