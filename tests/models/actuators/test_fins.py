"""Fins and propellers: printed derivatives, any angle of attack, astern, energy, bad files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.actuators.fins import fin_force, fin_geometry
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare

WITH_FINS = sorted(p.parent.name for p in content("models", "vehicles").glob("*/fins.yaml"))
FLAT = {
    "rho": 1000.0,
    "S": 0.02,
    "C_L_alpha": 3.0,
    "C_D_0": 0.01,
    "C_D_n": 1.1,
    "alpha_stall": 0.3,
}
six = st.lists(st.floats(-3, 3), min_size=6, max_size=6).map(np.array)
R, A = np.array([-0.6, 0.05, -0.1]), np.array([0.0, 0.0, 1.0])


def force(nu: Any, delta: float, a: np.ndarray = A, r: np.ndarray = R, **p: float) -> np.ndarray:
    expression = fin_force(ca.SX(np.asarray(nu, dtype=float)), ca.SX(r), ca.SX(a), delta, FLAT | p)
    return np.array(ca.evalf(ca.SX(expression))).ravel()


def tau(vehicle: str, u: list[float], nu_r: list[float]) -> np.ndarray:
    r = simulate(declare("fins", vehicle=vehicle), until=8, h=0.02, inputs={"u": u, "nu_r": nu_r})
    return np.asarray(r["tau"][-1])


@pytest.mark.parametrize("vehicle", WITH_FINS)
def test_fins_that_are_not_turned_add_what_the_hull_lacks_and_no_more(vehicle: str) -> None:
    n = len(fin_geometry(vehicle).names)
    found = tau(vehicle, [0.0] * n, [1.0, 0.2, -0.1, 0.1, 0.05, 0.1])
    assert np.any(found != 0) != fin_geometry(vehicle).in_hull


# ---- any angle, astern --------------------------------------------------------------------------


@given(six, st.floats(-1.5, 1.5))
@settings(max_examples=200, deadline=None)
def test_a_fin_only_takes_energy_from_any_side_at_any_deflection(
    nu: np.ndarray, delta: float
) -> None:
    there = nu[:3] + np.cross(nu[3:], R)
    assert force(nu, delta) @ there <= 1e-9


@given(st.floats(-3.1, 3.1))
@settings(max_examples=50, deadline=None)
def test_lift_does_no_work(alpha: float) -> None:
    nu = [np.cos(alpha), np.sin(alpha), 0, 0, 0, 0]
    push = force(nu, 0.0, r=np.zeros(3), C_D_0=0.0, C_D_n=0.0)
    assert push @ np.array(nu[:3]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("alpha", [0.0, 0.1, 0.29, 0.31, 0.8, 1.5])
def test_a_fin_is_alike_met_from_ahead_and_from_astern(alpha: float) -> None:
    ahead = force([np.cos(alpha), np.sin(alpha), 0, 0, 0, 0], 0.0, r=np.zeros(3))
    astern = force([-np.cos(alpha), np.sin(alpha), 0, 0, 0, 0], 0.0, r=np.zeros(3))
    np.testing.assert_allclose(astern, ahead * [-1, 1, 1], atol=1e-12)


def test_broadside_a_fin_is_a_plate_that_lifts_nothing() -> None:
    push = force([0, 2.0, 0, 0, 0, 0], 0.0, r=np.zeros(3))
    np.testing.assert_allclose(push, [0, -0.5 * 1000 * 0.02 * 1.11 * 4, 0], atol=1e-12)


def test_lift_grows_up_to_the_stall_and_no_further() -> None:
    lifts = [
        -force([np.cos(a), np.sin(a), 0, 0, 0, 0], 0.0, r=np.zeros(3), C_D_0=0, C_D_n=0)[1]
        / np.cos(a) ** 2
        for a in (0.1, 0.3, 0.6, 1.2)
    ]
    assert lifts[0] == pytest.approx(10 * 3.0 * np.sin(0.1), rel=1e-12)
    np.testing.assert_allclose(lifts[1:], 10 * 3.0 * np.sin(0.3), rtol=1e-12)


def test_going_astern_the_rudder_turns_the_other_way() -> None:
    ahead, astern = (tau("remus100", [0.1, 0.1, 0, 0], [u, 0, 0, 0, 0, 0])[5] for u in (1, -1))
    assert ahead == pytest.approx(-astern, rel=1e-9)


def test_a_servo_is_of_first_order_and_stops_at_its_limit() -> None:
    m = declare("fins", vehicle="remus100")
    r = simulate(m, at=[0, 0.1, 5], h=1e-3, inputs={"u": [0.1, -0.1, 9.0, 0.0]})
    np.testing.assert_allclose(
        r["delta"][1, :2], np.array([1, -1]) * 0.1 * (1 - np.exp(-1)), rtol=1e-9
    )
    assert r["delta"][2, 2] == pytest.approx(np.deg2rad(13.6), rel=1e-9)


def test_a_generalised_force_is_led_through_contact() -> None:
    m = declare("fins", vehicle="lauv", contact=True)
    r = simulate(m, at=[0.0], inputs={"contact": [1, 2, 3, 4, 5, 6]})
    np.testing.assert_array_equal(r["tau"][0], [1, 2, 3, 4, 5, 6])


# ---- propellers ---------------------------------------------------------------------------------


def steady(vehicle: str, u: float, V: float, **options: Any) -> Any:
    m = declare("propeller", vehicle=vehicle, **options)
    return simulate(m, until=15, h=0.01, inputs={"u": u, "nu_r": [V, 0, 0, 0, 0, 0]})


def test_thrust_at_rest_and_on_the_way_is_wageningens() -> None:
    """K_T(0) = 0.4566 and K_T(0.6632) = 0.1798, times 0.9 for the thrust deduction."""
    n, D = 1525 / 60, 0.14
    V = 0.6632 * n * D / 0.944
    for speed, K_T in ((0.0, 0.4566), (V, 0.1798)):
        thrust = steady("remus100", 1.0, speed)["thrust"][-1]
        assert thrust == pytest.approx(0.9 * 1026 * K_T * n * n * D**4, rel=1e-5)


def test_turning_back_a_propeller_that_goes_ahead_brakes_more_than_at_rest() -> None:
    at_rest, ahead = (steady("remus100", -1.0, V)["thrust"][-1] for V in (0.0, 1.5))
    assert ahead < at_rest < 0


def test_tethys_reaches_the_speed_that_its_project_asserts() -> None:
    """300 rpm: 1.01 m/s within 0.1; rho k_T n² D⁴ = 6.2282 u² gives 1.0586."""
    n_max = declare("propeller", vehicle="tethys_lrauv").variables["n_max"].start[0]
    thrust = steady("tethys_lrauv", 31.4159265 / n_max, 1.0)["thrust"][-1]
    assert np.sqrt(thrust / 6.2282) == pytest.approx(1.0586355, abs=1e-6)
    assert np.sqrt(thrust / 6.2282) == pytest.approx(1.01, abs=0.1)


@pytest.mark.parametrize(
    ("vehicle", "number", "thrust"),
    [("rexrov", 8, 2000), ("rexrov2", 1, 1540), ("desistek_saga", 3, 20), ("lauv", 1, 50)],
)
def test_full_command_is_the_published_thrust(vehicle: str, number: int, thrust: float) -> None:
    assert steady(vehicle, 1.0, 0.0, number=number)["thrust"][-1] == pytest.approx(thrust, rel=1e-6)


def test_a_propeller_that_is_not_there_is_refused() -> None:
    with pytest.raises(InputInvalid, match="propeller 9 of rexrov; expected 1 to 8"):
        declare("propeller", vehicle="rexrov", number=9)


# ---- mistakes -----------------------------------------------------------------------------------


def test_a_vehicle_without_fins_is_refused_by_name() -> None:
    with pytest.raises(ParameterInvalid, match="no fins of 'rexrov'"):
        declare("fins", vehicle="rexrov")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("a: {value: [0, 0, 1]", "a: {value: [0, 0, 2]", "expected length 1"),
        ("S: {value: 0.00665, unit: m2", "S: {value: 0.00665, unit: m", "expected 'm2'"),
        ("  C_D_n:", "  C_D_m:", "C_D_m"),
        ("undeflected_in_hull: true", "undeflected_in_hull: maybe", "expected true where"),
    ],
)
def test_a_mistake_in_a_fin_is_named_with_its_line(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    source = content("models", "vehicles", "remus100")
    for name in ("parameters.yaml", "fins.yaml"):
        (tmp_path / name).write_text((source / name).read_text())
    text = (source / "fins.yaml").read_text()
    assert old in text
    (tmp_path / "fins.yaml").write_text(text.replace(old, new, 1))
    with pytest.raises(ParameterInvalid) as caught:
        declare("fins", vehicle=str(tmp_path))
    assert message in str(caught.value)
    assert "fins.yaml:" in str(caught.value)
