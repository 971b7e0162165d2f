"""The linear model beside which predictions are judged."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.studies.water.linear_model import fit_linear_model

RUNS = ((0, 900),)


def oscillator(h: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return position (1, 901) and held force (1, 900) of a damped oscillator of 1 rad/s."""
    from scipy.linalg import expm

    force = np.random.default_rng(0).normal(size=900)
    exact = expm(np.array([[0.0, 1.0, 0.0], [-1.0, -0.4, 1.0], [0.0, 0.0, 0.0]]) * h)
    x = np.zeros((2, 901))
    for k in range(900):
        x[:, k + 1] = exact[:2, :2] @ x[:, k] + exact[:2, 2] * force[k]
    return x[:1], force[None]


def test_an_oscillator_is_predicted_exactly() -> None:
    y, u = oscillator(0.25)
    model = fit_linear_model(y, u, RUNS, 0.25)
    at = np.arange(100, 700, 10)
    predicted = model.predict(y, u, at, 40)
    assert predicted[:, 0] == pytest.approx(y[0, at + 40], abs=1e-6)


def test_no_measurement_after_the_point_is_used() -> None:
    y, u = oscillator(0.25)
    model = fit_linear_model(y, u, RUNS, 0.25)
    at = np.array([300])
    before = model.predict(y, u, at, 40)
    y[:, 301:] = 1e3
    assert model.predict(y, u, at, 40) == pytest.approx(before)
