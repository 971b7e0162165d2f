"""Shafts, curves, limits and faults of thrusters, propellers and fins: what each option claims."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import signal

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.actuators.faults import thruster_faults
from uuvsim_cosim.models.actuators.thruster import SHAFTS
from uuvsim_cosim.models.analysis.simulate import Trajectory, simulate
from uuvsim_cosim.models.declaration.library import declare

N_MAX = 369.97
K_N = 3.7614e-4


def step(model: Any, until: float = 0.4, h: float = 1e-3, **given: Any) -> Trajectory:
    inputs = {"u": 1.0, "voltage": 16.0} | given.pop("inputs", {})
    return simulate(model, until=until, h=h, inputs=inputs, parameters=given)


@pytest.mark.parametrize("kind", SHAFTS)
def test_every_shaft_reaches_the_speed_that_is_wanted_and_rests_at_none(kind: str) -> None:
    model = declare("thruster", shaft=kind)
    assert step(model, 3.0, 5e-3)["n"][-1] == pytest.approx(N_MAX, rel=2e-3)
    assert np.all(step(model, 0.1, 5e-3, inputs={"u": 0.0})["n"] == 0.0)


@pytest.mark.parametrize(
    ("kind", "top", "bottom"),
    [
        ("second", [90.9**2], [1.0, 2 * 0.417 * 90.9, 90.9**2]),
        ("third", [6136.0, 108700.0], [1.0, 89.0, 9258.0, 108700.0]),
    ],
)
def test_a_linear_shaft_is_its_transfer_function(kind: str, top: Any, bottom: Any) -> None:
    r = step(declare("thruster", shaft=kind))
    _, expected = signal.step((top, bottom), T=r.t)
    np.testing.assert_allclose(r["n"], N_MAX * expected, atol=1e-3)


def test_the_second_order_shaft_is_the_oscillating_pair_of_the_third() -> None:
    pair = np.roots([1.0, 89.0, 9258.0, 108700.0])[0]
    assert abs(pair) == pytest.approx(90.9, abs=0.05)
    assert -pair.real / abs(pair) == pytest.approx(0.417, abs=1e-3)


def test_yoergers_shaft_rises_as_its_hyperbolic_tangent() -> None:
    """dn/dt = alpha (n_d² - n²) from rest: n = n_d tanh(alpha n_d t)."""
    r = step(declare("thruster", shaft="yoerger"))
    np.testing.assert_allclose(r["n"], N_MAX * np.tanh(0.0471 * N_MAX * r.t), rtol=1e-6, atol=1e-6)


def test_bessas_motor_sags_with_its_voltage() -> None:
    """Steady:  k_t (u V - k_t n) / R_m = k_v n²."""
    model = declare("thruster", shaft="bessa")
    for voltage in (16.0, 12.0):
        n = step(model, 2.0, 5e-3, inputs={"voltage": voltage})["n"][-1]
        assert 0.0195 * (voltage - 0.0195 * n) / 0.238 == pytest.approx(5.27e-6 * n * n, rel=1e-6)
    assert n < 0.85 * N_MAX


def test_inside_its_dead_band_a_command_turns_nothing_and_full_stays_full() -> None:
    model = declare("thruster", dead_band=True)
    assert step(model, inputs={"u": 0.069})["n"][-1] == 0.0
    assert step(model, inputs={"u": -1.0})["n"][-1] == pytest.approx(-N_MAX, rel=1e-5)


@pytest.mark.parametrize("name", ["thruster", "thruster_t200", "propeller"])
def test_a_limited_command_rises_no_faster_than_its_limit(name: str) -> None:
    r = step(declare(name, limits="true"), 0.6, 5e-3, rate_max=2.0)
    assert np.max(np.diff(r["command"])) <= 2.0 * 5e-3 + 1e-12
    assert r["command"][-1] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("name", ["thruster", "thruster_t200", "propeller"])
def test_without_faults_the_option_changes_no_steady_value(name: str) -> None:
    options: tuple[dict[str, Any], ...] = ({}, {"faults": True})
    plain, able = (step(declare(name, **o), 3.0, 5e-3, T_n=0.05) for o in options)
    for output in ("thrust", "n", "current"):
        assert able[output][-1] == pytest.approx(plain[output][-1], rel=1e-4)


@pytest.mark.parametrize("name", ["thruster", "thruster_t200", "propeller"])
def test_each_fault_does_what_it_says(name: str) -> None:
    model = declare(name, faults=True)
    whole = step(model, 1.5, 5e-3, T_n=0.05)
    for health in (0.0, 0.4, -1.0):
        r = step(model, 1.5, 5e-3, T_n=0.05, health=health)
        assert r["thrust"][-1] == pytest.approx(health * whole["thrust"][-1], abs=1e-9)
    assert step(model, 1.5, 5e-3, T_n=0.05, stuck=1.0)["thrust"][-1] == 0.0, "stuck at rest"
    wound = step(model, 1.5, 5e-3, T_n=0.05, entangled=0.5)
    assert wound["n"][-1] == pytest.approx(0.5 * whole["n"][-1], rel=1e-6)
    if name != "propeller":
        assert wound["current"][-1] > 0.5 * whole["current"][-1], "the line takes the power"


def test_a_jet_has_the_same_faults() -> None:
    model = declare("thruster_jet", faults=True, limits=True)
    whole = step(model, 1.5, 5e-3)["thrust"][-1]
    assert whole == pytest.approx(2.73, abs=0.01)
    assert step(model, 1.5, 5e-3, health=-1.0)["thrust"][-1] == pytest.approx(-whole)
    assert step(model, 1.5, 5e-3, entangled=0.5)["thrust"][-1] == pytest.approx(0.25 * whole)
    assert step(model, 1.5, 5e-3, stuck=1.0)["thrust"][-1] == 0.0


def test_ventilation_takes_thrust_near_the_surface_and_all_of_it_in_air() -> None:
    model = declare("propeller", ventilation=True)
    still = {"nu_r": np.zeros(6)}

    def thrust(depth: float) -> float:
        inputs = still | {"eta": [0, 0, depth, 0, 0, 0]}
        return float(step(model, 1.5, 5e-3, inputs=inputs, T_n=0.05)["thrust"][-1])

    full = thrust(5.0)
    R = 0.07
    assert thrust(1.31 * R) == pytest.approx(full, rel=1e-6)
    assert thrust(R) == pytest.approx(full * (1 - 0.675 * (1 - 0.769) ** 1.258), rel=1e-6)
    assert thrust(-0.5 * R) == pytest.approx(0.0, abs=5e-3 * full)


def test_a_fin_stuck_stays_and_a_lost_one_steers_no_more() -> None:
    model = declare("fins", faults=True, limits=True)
    inputs = {"u": [0.2] * 4, "nu_r": [1.5, 0, 0, 0, 0, 0]}
    given = {"stuck": [1, 0, 0, 0], "health": [1, 0, 1, 1], "delta_rate": 0.1}
    r = simulate(model, until=1.0, h=0.01, inputs=inputs, parameters=given)
    np.testing.assert_allclose(r["delta"][-1, 0], 0.0)
    np.testing.assert_allclose(r["delta"][-1, 1:], 0.1, atol=1e-9)
    force = r["force"][-1].reshape(4, 3)
    assert np.linalg.norm(force[1]) == 0.0
    assert np.linalg.norm(force[2]) > 0.01


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("thruster", {"shaft": "zeroth"}, "first, second, third, yoerger, bessa"),
        ("thruster_t200", {"shaft": "bessa"}, "first, second, third, yoerger"),
        ("thruster", {"curve": "cubic"}, "quadratic or bessa"),
        ("thruster", {"faults": "perhaps"}, "true or false"),
        ("fins", {"form": "wings"}, "lift or derivatives"),
    ],
)
def test_an_option_that_does_not_exist_is_refused_with_those_that_do(
    name: str, options: dict[str, str], message: str
) -> None:
    with pytest.raises(InputInvalid, match=message.replace(" or ", ".*")):
        declare(name, **options)


def test_a_thruster_gives_all_until_its_fault_and_its_share_afterwards() -> None:
    given = {"efficiency": [0.0, 0.4, 1.0], "t": [1.0, 2.0, 0.0]}
    inputs = {"thrust_in": (10.0, -20.0, 30.0)}
    run = simulate(thruster_faults(3), until=3, h=1.0, inputs=inputs, parameters=given)
    np.testing.assert_allclose(run["thrust"][:, 0], [10, 0, 0, 0])
    np.testing.assert_allclose(run["thrust"][:, 1], [-20, -20, -8, -8])
    np.testing.assert_allclose(run["thrust"][:, 2], 30)
    np.testing.assert_allclose(run["health"][-1], [0.0, 0.4, 1.0])


def test_an_unknown_bench_lists_those_that_there_are() -> None:
    with pytest.raises(
        ParameterInvalid, match="bench=foo: no such bench rows; expected t200, t200_"
    ):
        declare("thruster_t200", bench="foo")
