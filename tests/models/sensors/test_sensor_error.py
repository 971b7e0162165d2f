from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.sensors.sensor_error import (
    ErrorParameters,
    random_walk_sigma,
    sensor_error,
    uniform,
)

AXES = 4000
FIGURES = ErrorParameters(noise_density=0.3, bias_sigma=0.5, bias_tau=2.0, turn_on_sigma=0.8)


def errors(lanes: Any, period: str, p: ErrorParameters, until: float) -> np.ndarray:
    """Rows of readings of pure error, one axis a lane, from 0 to `until`."""
    m = Model("error")
    clock = m.clock("sample", period)
    value = m.discrete("value", unit="m")
    m.update(clock, value, sensor_error(m, clock, "", p, 1, "m"))
    m.output("y", value, unit="m")
    run, T = lanes(m, AXES), float(period)
    return np.array([run.step(k * T, T)["y"][0] for k in range(round(until / T) + 1)])


@pytest.mark.parametrize("period", ["0.05", "0.5"])
def test_variance_is_that_of_turn_on_wandering_bias_and_white_noise(
    lanes: Any, period: str
) -> None:
    rows = errors(lanes, period, FIGURES, 4.0)
    expected = 0.8**2 + 0.5**2 + 0.3**2 / float(period)
    for row in (rows[0], rows[-1]):
        assert np.var(row) == pytest.approx(expected, rel=0.1)
        assert abs(np.mean(row)) < 4.5 * np.sqrt(expected / AXES)


@pytest.mark.parametrize("period", ["0.05", "0.5"])
@pytest.mark.parametrize("lag", [1.0, 3.0])
def test_autocorrelation_of_the_bias_falls_with_time_whatever_the_step(
    lanes: Any, period: str, lag: float
) -> None:
    p = ErrorParameters(0.0, 0.5, 2.0, 0.0)
    rows = errors(lanes, period, p, lag)
    covariance = np.mean(rows[0] * rows[-1])
    assert covariance == pytest.approx(0.25 * np.exp(-lag / 2.0), abs=4.5 * 0.25 / AXES**0.5)


def test_turn_on_bias_is_drawn_once(lanes: Any) -> None:
    rows = errors(lanes, "0.1", ErrorParameters(0.0, 0.0, 1.0, 0.8), 1.0)
    assert np.all(rows == rows[0])
    assert np.std(rows[0]) == pytest.approx(0.8, rel=0.06)


def test_mean_over_one_second_of_white_noise_does_not_depend_on_the_step(lanes: Any) -> None:
    for period in ("0.05", "0.2"):
        rows = errors(lanes, period, ErrorParameters(0.3, 0.0, 1.0, 0.0), 1.0 - float(period))
        assert np.std(np.mean(rows, axis=0)) == pytest.approx(0.3, rel=0.06)


def test_random_walk_density_becomes_stationary_deviation() -> None:
    assert random_walk_sigma(3.8785e-5, 1000.0) == pytest.approx(8.67e-4, rel=1e-3)


def test_uniform_draws_are_uniform(lanes: Any) -> None:
    m = Model("uniform")
    clock = m.clock("sample", "1")
    x = m.discrete("x", unit="1")
    m.update(clock, x, uniform(m, clock))
    m.output("y", x, unit="1")
    draws = np.sort(lanes(m, AXES).step(0.0, 1.0)["y"][0])
    distance = np.max(np.abs(draws - (np.arange(AXES) + 0.5) / AXES))
    assert distance < 1.95 / AXES**0.5  # Kolmogorov-Smirnov at 0.1 %
