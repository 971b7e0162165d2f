"""The Allan deviation: its closed form, and that simulated IMUs have the one of their data sheets.

The figures of the data sheets are written here again, in the sheets' own units.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.sensors.allan import (
    allan_deviation,
    allan_of_error,
    lowest_allan,
    sigma_of_instability,
)
from uuvsim_cosim.models.sensors.imu import imu

DEG, HOUR, G = np.pi / 180, 3600.0, 9.80665
# angle random walk, gyro bias instability, velocity random walk, accelerometer bias instability
SHEETS: dict[str, Any] = {
    "stim300": (0.15 * DEG / 60, 0.5 * DEG / HOUR, 0.06 / 60, 0.05e-3 * G, 8000),
    "adis16495": (0.09 * DEG / 60, 0.8 * DEG / HOUR, None, 3.2e-6 * G, 3000),
    "mpu6050": (0.005 * DEG, None, 400e-6 * G, None, 1500),
}


def test_of_white_noise_it_is_the_density_over_the_root_of_time() -> None:
    record = np.random.default_rng(1).normal(0.0, 0.3 / np.sqrt(0.1), (20000, 16))
    t = np.array([0.1, 1.0, 10.0])
    assert allan_deviation(record, 0.1, t) == pytest.approx(0.3 / np.sqrt(t), rel=0.05)


def test_of_a_ramp_it_is_the_rate_times_time_over_root_two() -> None:
    t = np.array([1.0, 5.0])
    assert allan_deviation(0.2 * np.arange(50.0), 1.0, t) == pytest.approx(0.2 * t / np.sqrt(2))


def test_of_a_gauss_markov_bias_it_is_the_closed_form() -> None:
    rng, phi = np.random.default_rng(2), np.exp(-1.0 / 20.0)
    b = np.zeros((4000, 60))
    b[0] = rng.normal(size=60)
    for k in range(1, len(b)):
        b[k] = phi * b[k - 1] + np.sqrt(1 - phi**2) * rng.normal(size=60)
    t = np.array([5.0, 20.0, 40.0, 100.0])
    assert allan_deviation(b, 1.0, t) == pytest.approx(allan_of_error(t, 0, 1, 20.0), rel=0.04)


def test_the_closed_form_has_no_step_where_its_series_begins() -> None:
    below, above = allan_of_error([0.999999, 1.000001], 0.0, 1.0, 1000.0)
    assert above == pytest.approx(below, rel=1e-3)


@pytest.mark.parametrize(("N", "B", "tau"), [(1.0, 2.0, 100.0), (1e-4, 1e-5, 3600.0)])
def test_the_lowest_value_of_the_curve_is_the_bias_instability(
    N: float, B: float, tau: float
) -> None:
    assert lowest_allan(N, sigma_of_instability(N, B, tau), tau)[0] == pytest.approx(B, rel=1e-9)


def test_a_tau_too_short_for_the_bias_instability_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="expected at least 400 s"):
        sigma_of_instability(1.0, 0.1, 100.0)


def test_a_record_too_short_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="more than twice"):
        allan_deviation(np.zeros(10), 1.0, [5.0])


@pytest.mark.parametrize("id", SHEETS)
def test_a_simulated_imu_has_the_allan_deviation_of_its_data_sheet(lanes: Any, id: str) -> None:
    """Random walks within 3 %, the lowest point of the curve within 6 % of the instability."""
    *figures, steps = SHEETS[id]
    run = lanes(imu(id, period="1"), 16)
    records: dict[str, list[np.ndarray]] = {"gyro": [], "acc": []}
    for k in range(steps):
        run.step(float(k), 1.0)
        for axis, record in records.items():
            record.append(run[axis].ravel())
    t = np.unique(np.rint(np.logspace(0, np.log10(steps / 10), 25)))
    for axis, walk, instability in (("gyro", *figures[:2]), ("acc", *figures[2:])):
        curve = allan_deviation(np.array(records[axis]), 1.0, t)
        if walk is not None:
            assert curve[0] == pytest.approx(walk, rel=0.03)
        if instability is not None:
            assert np.min(curve) == pytest.approx(instability, rel=0.06)
