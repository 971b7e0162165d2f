"""The pilot's commands: limits, and the force of steady motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.guidance.pilot import pilot
from uuvsim_cosim.models.hull.matrices import nominal

T = 0.02


def held(lanes: Any, n: int, a: float, omega: float, nu: Any = (0,) * 6) -> Any:
    run = lanes(pilot())
    for k in range(n):
        run.step(k * T, T, a=a, omega=omega, nu=nu, eta=[0, 0, 0.5, 0, 0, 0])
    return run


def test_wanted_speed_is_the_integral_of_the_acceleration(lanes: Any) -> None:
    assert held(lanes, 25, 0.3, 0.0)["nu_d"][0] == pytest.approx(0.15, abs=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_wanted_speed_and_yaw_rate_stay_within_their_limits(lanes: Any, sign: int) -> None:
    nu_d = held(lanes, 500, 9.0 * sign, 7.0 * sign)["nu_d"]
    assert nu_d[[0, 5]] == pytest.approx([0.4 * sign, 1.5 * sign], abs=1e-9)


def test_acceleration_beyond_its_limit_counts_as_the_limit(lanes: Any) -> None:
    assert held(lanes, 10, 9.0, 0.0)["nu_d"][0] == pytest.approx(0.4 * 10 * T)


def test_steady_motion_needs_drag_and_the_force_of_the_turn_alone(lanes: Any) -> None:
    mass, linear, quadratic = nominal("pool8")
    run = lanes(pilot(), parameters={"k_i": 0.0})
    nu = np.array([0.4, 0, 0, 0, 0, 1.5])
    for k in range(600):
        run.step(k * T, T, a=0.4, omega=1.5, nu=nu, eta=[0, 0, 0.5, 0, 0, 0])
    drag = np.array(linear) * nu + np.array(quadratic) * np.abs(nu) * nu
    wanted = [drag[0], mass[0] * 0.4 * 1.5, 0, 0, 0, drag[5]]
    np.testing.assert_allclose(run["tau_d"], wanted, atol=1e-9)


def test_integrals_stay_within_their_limits(lanes: Any) -> None:
    run = held(lanes, 5000, 0.4, 1.5)
    np.testing.assert_allclose(run["z"], [0.5, 0, 2.0], atol=1e-12)
