"""The tether, variable ballast and the moving mass: closed forms, and what others assert."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.hull.ballast import ballast
from uuvsim_cosim.models.hull.tether import tether

K = 0.5 * 1025.0 * 0.0076


def of_tether(parameters: dict[str, Any] | None = None, **inputs: Any) -> Any:
    return simulate(tether(), at=[0.0], inputs=inputs, parameters=parameters)


def test_a_current_across_the_cable_loads_the_hull_with_half_its_drag() -> None:
    tau = of_tether(eta=[0, 0, 20, 0, 0, 0], v_c=[0, 0.5, 0])["tau"][0]
    np.testing.assert_allclose(tau, [0, 0.5 * K * 1.2 * 0.25 * 20, 0, 0, 0, 0], atol=1e-12)


def test_a_hull_that_pulls_a_cable_across_bears_a_quarter() -> None:
    """Velocity grows along the cable: the integral of s · s² is 1/4."""
    tau = of_tether(eta=[0, 0, 20, 0, 0, 0], nu=[0.5, 0, 0, 0, 0, 0])["tau"][0]
    np.testing.assert_allclose(tau[0], -0.25 * K * 1.2 * 0.25 * 20, atol=1e-12)


def test_along_the_cable_there_is_friction_alone() -> None:
    tau = of_tether(eta=[30, 0, 0, 0, 0, 0], v_c=[1.0, 0, 0])["tau"][0]
    np.testing.assert_allclose(tau[0], 0.5 * K * np.pi * 0.02 * 30, atol=1e-12)


def test_weight_is_shared_and_beyond_its_length_it_pulls() -> None:
    given = {"w": 0.4, "l_0": 20.0, "E_A": 1000.0}
    r = of_tether(given, eta=[0, 0, 22.0, 0, 0, 0])
    assert r["tension"][0] == pytest.approx(100.0)
    np.testing.assert_allclose(r["tau"][0, 2], 0.5 * 0.4 * 22 - 100.0, atol=1e-9)


def test_the_force_is_about_CO_in_b_and_others_are_led_through() -> None:
    eta, r = [0, 0, 20, 0.2, -0.3, 0.8], [-0.2, 0.0, -0.1]
    given, inputs = {"r": r}, {"eta": eta, "v_c": [0.4, 0.3, 0.0]}
    alone = of_tether(given, **inputs)["tau"][0]
    np.testing.assert_allclose(alone[3:], np.cross(r, alone[:3]), atol=1e-12)
    contact = np.arange(6.0)
    both = simulate(tether(True), at=[0.0], inputs=inputs | {"contact": contact}, parameters=given)
    np.testing.assert_allclose(both["tau"][0], alone + contact, atol=1e-12)


velocities = st.tuples(*(st.floats(-2, 2) for _ in range(6)))


@settings(max_examples=25, deadline=None, derandomize=True)
@given(nu=velocities, at=st.tuples(*(st.floats(-20, 20) for _ in range(3))))
def test_in_still_water_a_slack_tether_only_takes_energy(nu: Any, at: Any) -> None:
    tau = of_tether({"r": [0.1, 0, -0.2]}, eta=[*at, 0.3, 0.2, 1.0], nu=nu)["tau"][0]
    assert np.all(np.isfinite(tau))
    assert tau @ np.array(nu) <= 1e-9


# ---- ballast ------------------------------------------------------------------------------------


def test_the_bladder_lifts_by_the_water_that_it_displaces_and_no_faster_than_its_pump() -> None:
    r = simulate(ballast(), until=200.0, h=0.5, inputs={"V_d": 1.0})
    assert r["volume"][-1] == pytest.approx(9.55e-4)
    assert r["tau"][-1, 2] == pytest.approx(-1025.0 * 9.80665 * 4.55e-4)
    at = 100.0
    assert r["volume"][r.t == at][0] == pytest.approx(5e-4 + 3e-6 * at, rel=1e-6)


def test_mass_that_moves_forward_turns_by_its_weight_and_shift() -> None:
    shift = simulate(ballast(), at=[0.0, 60.0], h=0.05, inputs={"x_d": 0.01})
    assert shift["shift"][-1] == pytest.approx(0.01, abs=1e-9)
    assert shift["tau"][-1, 4] == pytest.approx(-31.7307 * 9.80665 * 0.01)
