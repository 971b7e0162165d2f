"""Thrusters, what they push on, and what feeds them."""

import numpy as np
import pytest

from uuvsim_cosim.models.actuators.bench_rows import read_bench
from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare

T200 = Evaluation(declare("thruster_t200"))


def steady(u: float, voltage: float) -> tuple[float, float, float]:
    """Thrust [N], n [rad/s], current [A] where dn/dt = 0."""
    inputs = T200.values_of("input", {"u": u, "voltage": voltage})
    p = T200.values_of("parameter", {})
    d = T200.derived(p)
    n = float(p[0] * T200.rhs(0, inputs, p, d, 0.0, []))
    assert float(T200.rhs(0, inputs, p, d, n, [])) == pytest.approx(0, abs=1e-9)
    thrust, speed, current = np.array(T200.outputs(0, inputs, p, d, n, [])).ravel()
    return thrust, speed, current


@pytest.mark.parametrize(("u", "thrust"), [(1, 51.485), (-1, -39.913)])
def test_full_throttle_at_16_V_has_the_published_thrust(u: float, thrust: float) -> None:
    r = simulate(declare("thruster_t200"), until=1, h=5e-3, inputs={"u": u, "voltage": 16})
    assert r["thrust"][-1] == pytest.approx(thrust, abs=1e-3)


@pytest.mark.parametrize(("u", "thrust"), [(1, 44.4), (-1, -34.5)])
def test_between_the_voltages_it_is_near_the_second_published_fit(u: float, thrust: float) -> None:
    assert steady(u, 14.0)[0] == pytest.approx(thrust, rel=0.02)


@pytest.mark.parametrize(("voltage", "edges"), [(12, (1464, 1536)), (16, (1472, 1528))])
def test_inside_the_dead_band_nothing_turns(voltage: float, edges: tuple[int, int]) -> None:
    for pwm in (*edges, 1500, 1510):
        assert steady((pwm - 1500) / 400, voltage) == (0.0, 0.0, 0.0)


def test_thrust_follows_the_shaft_and_not_the_command() -> None:
    r = simulate(declare("thruster_t200"), until=0.1, h=1e-3, inputs={"u": 1, "voltage": 16})
    assert r["thrust"][0] == 0.0
    at = 29
    assert r["n"][at] / 369.975 == pytest.approx(0.6321, abs=0.01)


def test_thrust_rises_with_shaft_speed_at_every_voltage() -> None:
    _, rows = read_bench("t200").thrust_over_n()
    assert np.all(np.diff(rows) >= 0)


def test_the_quadratic_thruster_reaches_the_t200s_peak() -> None:
    r = simulate(declare("thruster"), until=1, h=5e-3, inputs={"u": 1})
    assert r["thrust"][-1] == pytest.approx(51.485, abs=0.01)
    assert r["current"][-1] == pytest.approx(23.83, abs=0.05)


def test_both_thrusters_have_the_same_connectors() -> None:
    connectors = [
        [(v.name, v.kind, v.unit, v.shape) for v in declare(n).of_kind("input", "output")]
        for n in ("thruster", "thruster_t200")
    ]
    assert connectors[0] == connectors[1]


def test_the_wrench_is_force_and_lever_times_force() -> None:
    thrust = np.arange(1.0, 9.0)
    inputs = {"thrust": thrust, "current": thrust}
    r = simulate(declare("wrench"), until=1, h=1, inputs=inputs)
    geometry = thruster_geometry("bluerov2_heavy")
    force = (geometry.e * thrust[:, None]).sum(0)
    moment = np.cross(geometry.r, geometry.e * thrust[:, None]).sum(0)
    np.testing.assert_allclose(r["tau"][-1], [*force, *moment], atol=1e-12)
    np.testing.assert_allclose(
        r["tau"][-1], configuration_matrix(geometry) @ thrust, rtol=0, atol=1e-12
    )
    assert r["current_total"][-1] == 36.0


def test_the_eight_thrusters_reach_all_six_degrees_of_freedom() -> None:
    T = configuration_matrix(thruster_geometry("bluerov2_heavy"))
    assert np.linalg.matrix_rank(T) == 6


def test_equal_forward_thrust_of_the_front_pair_gives_no_yaw() -> None:
    T = configuration_matrix(thruster_geometry("bluerov2_heavy"))
    tau = T @ np.array([1, 1, -1, -1, 0, 0, 0, 0])
    np.testing.assert_allclose(tau[[1, 2, 3, 5]], 0, atol=1e-12)
    assert tau[0] == pytest.approx(4 * np.sqrt(0.5), abs=1e-7)


def test_the_battery_keeps_its_charge_in_balance() -> None:
    r = simulate(declare("battery"), until=720, h=0.1, inputs={"current": 45.0})
    assert r["state_of_charge"][-1] == pytest.approx(0.5, abs=1e-12)
    assert r["voltage"][-1] == pytest.approx(4 * 3.70 - 0.03 * 45.0, abs=2e-2)
    trapezoid = float(np.sum((r["voltage"][1:] + r["voltage"][:-1]) / 2) * 0.1 * 45.0)
    assert r["energy"][-1] == pytest.approx(trapezoid, rel=1e-4)


def test_the_battery_starts_at_its_open_circuit_voltage() -> None:
    r = simulate(declare("battery"), until=1, h=0.01, parameters={"soc_0": 0.5})
    np.testing.assert_allclose(r["voltage"], 14.8, atol=1e-12)
