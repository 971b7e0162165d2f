"""The jet's thrust is its momentum; the allocation to such thrusters is its inverse."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.models.actuators.thruster import largest_thrust
from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare

Q, A = 2.5 / 3600, np.pi / 4 * 0.015**2
T = configuration_matrix(thruster_geometry("pool8"))
ALLOCATION = Evaluation(declare("allocation_quadratic"))


def commands(tau: object) -> tuple[np.ndarray, float]:
    p = ALLOCATION.values_of("parameter", {})
    inputs = ALLOCATION.values_of("input", {"tau_d": tau})
    d = np.array(ALLOCATION.derived(p)).ravel()
    y = np.array(ALLOCATION.outputs(0, inputs, p, d, [], [])).ravel()
    return y[:8], float(y[8])


@pytest.mark.parametrize("u", [1.0, 0.5, -0.3, -1.0])
def test_thrust_is_rho_Q_squared_over_the_jets_section(u: float) -> None:
    r = simulate(declare("thruster_jet"), until=2, h=0.02, inputs={"u": u})
    assert r["thrust"][-1] == pytest.approx(1000 * abs(u) * u * Q * Q / A, rel=1e-4)
    assert r["flow"][-1] == pytest.approx(u * Q, rel=1e-4)


def test_flow_follows_the_command_with_its_time_constant() -> None:
    r = simulate(declare("thruster_jet"), until=0.05, h=1e-3, inputs={"u": 1})
    assert r["flow"][-1] / Q == pytest.approx(1 - np.exp(-1), abs=1e-6)


def test_a_step_of_20_ms_is_as_good_as_many() -> None:
    ends = [
        simulate(declare("thruster_jet"), until=0.1, h=h, inputs={"u": 1})["thrust"][-1]
        for h in (0.02, 1e-3)
    ]
    assert ends[0] == pytest.approx(ends[1], rel=1e-3)


def test_current_is_the_jets_power_over_efficiency_and_voltage() -> None:
    r = simulate(declare("thruster_jet"), until=2, h=0.02, inputs={"u": -1, "voltage": 10})
    assert r["current"][-1] == pytest.approx(1000 * Q**3 / (2 * A * A) / 0.3 / 10, rel=1e-4)


def test_commands_make_the_force_that_was_wanted() -> None:
    tau = np.array([2.0, -1.0, -0.5, 0.02, -0.03, 0.1])
    u, saturation = commands(tau)
    thrust = largest_thrust() * np.abs(u) * u
    assert saturation == 1.0
    np.testing.assert_allclose(T @ thrust, tau, atol=1e-7)


def test_a_force_beyond_reach_keeps_its_direction() -> None:
    tau = np.array([30.0, 10.0, 0.0, 0.0, 0.0, 0.3])
    u, saturation = commands(tau)
    made = T @ (largest_thrust() * np.abs(u) * u)
    assert np.max(np.abs(u)) == pytest.approx(1.0)
    np.testing.assert_allclose(made, tau * saturation, atol=1e-5)


def test_commands_are_continuous_and_odd_near_zero() -> None:
    sizes = np.linspace(-0.02, 0.02, 81)
    u = np.array([commands([x, 0, 0, 0, 0, 0])[0][0] for x in sizes])
    np.testing.assert_allclose(u, -u[::-1], atol=1e-12)
    assert np.max(np.diff(u)) < 0.01
