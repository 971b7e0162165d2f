from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.actuators.bench_rows import read_bench
from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.control.allocation import allocation, command_of_thrust

T = configuration_matrix(thruster_geometry("bluerov2_heavy"))
TAU = np.array([20.0, -10.0, 15.0, 1.0, -0.5, 2.0])


def allocated(lanes: Any, tau: Any, health: Any = (1,) * 8) -> Any:
    run = lanes(allocation())
    run.u[run._place("input", "tau_d")] = np.reshape(tau, (-1, 1))
    run.u[run._place("input", "health")] = np.reshape(health, (-1, 1))
    run.y = run._evaluate(0.0)
    return run


def test_thrusts_make_the_wanted_force_with_the_pseudo_inverse(lanes: Any) -> None:
    run = allocated(lanes, TAU)
    assert run["f"] == pytest.approx(np.linalg.pinv(T) @ TAU, abs=1e-6)
    assert T @ run["f"] == pytest.approx(TAU, abs=1e-6)
    assert run["saturation"] == 1.0


@pytest.mark.parametrize("failed", range(8))
def test_one_failed_thruster_is_made_up_for(lanes: Any, failed: int) -> None:
    health = np.ones(8)
    health[failed] = 0.0
    run = allocated(lanes, 0.3 * TAU, health)
    assert run["f"][failed] == 0.0
    assert run["u"][failed] == 0.0
    assert T @ run["f"] == pytest.approx(0.3 * TAU, abs=1e-6)


def test_what_the_rest_cannot_make_is_left_out_without_blowing_up(lanes: Any) -> None:
    run = allocated(lanes, TAU, [0, 0, 0, 0, 1, 1, 1, 1])
    assert T @ run["f"] == pytest.approx([0, 0, 15.0, 1.0, -0.5, 0], abs=1e-4)
    assert np.max(np.abs(run["f"])) < 20.0


def test_without_any_thruster_nothing_is_commanded(lanes: Any) -> None:
    assert np.all(allocated(lanes, TAU, np.zeros(8))["u"] == 0.0)


def test_weak_thruster_is_asked_for_less(lanes: Any) -> None:
    whole = allocated(lanes, TAU)["f"]
    weak = allocated(lanes, TAU, [0.5, 1, 1, 1, 1, 1, 1, 1])["f"]
    assert abs(weak[0]) < abs(whole[0])


def test_saturation_keeps_the_direction_of_the_force(lanes: Any) -> None:
    run = allocated(lanes, 20 * TAU)
    made = T @ run["f"]
    assert run["saturation"][0] < 1.0
    assert made == pytest.approx(run["saturation"][0] * 20 * TAU, rel=1e-6)
    assert np.max(np.abs(run["u"])) == pytest.approx(1.0)


def test_commands_are_those_of_the_bench_rows_at_16_v(lanes: Any) -> None:
    bench = read_bench("t200")
    run = allocated(lanes, TAU)
    made = np.interp(run["u"], bench.u[-1], bench.thrust[-1])
    assert made == pytest.approx(run["f"], abs=0.05)


def test_no_force_is_no_command(lanes: Any) -> None:
    assert np.all(allocated(lanes, np.zeros(6))["u"] == 0.0)


def test_thrust_and_command_rise_together_through_zero() -> None:
    thrust, u = command_of_thrust("t200", 14.0)
    assert np.all(np.diff(thrust) > 0)
    assert np.all(np.diff(u) > 0)
    assert u[thrust.index(0.0)] == 0.0
    assert 28.4 < -thrust[0] < 40.0
    assert 36.0 < thrust[-1] < 51.5


def test_voltage_outside_the_bench_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match=r"24\.0 V; expected 12\.0 to 16\.0 V"):
        command_of_thrust("t200", 24.0)
