from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.control.controller import controller
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare

H = 0.02
AT = (0.0, 0.0, 5.0, 0.0, 0.0, 0.0)
NO_INTEGRAL = {"Ki": np.zeros(6)}


def tau(lanes: Any, parameters: Any = None, **inputs: Any) -> np.ndarray:
    run = lanes(controller(), parameters=NO_INTEGRAL | dict(parameters or {}))
    return np.array(run.step(0.0, H, **{"eta_d": AT, "eta": AT} | inputs)["tau_d"])


def test_no_error_needs_no_force(lanes: Any) -> None:
    assert tau(lanes) == pytest.approx(np.zeros(6), abs=1e-12)


def test_position_error_is_turned_into_body_axes(lanes: Any) -> None:
    east = tau(lanes, eta_d=[0, 0.5, 5, 0, 0, np.pi / 2], eta=[0, 0, 5, 0, 0, np.pi / 2])
    assert east == pytest.approx([80 * 0.5, 0, 0, 0, 0, 0], abs=1e-9)


def test_heading_error_takes_the_shortest_way(lanes: Any) -> None:
    over = tau(lanes, eta_d=[0, 0, 5, 0, 0, -3.1], eta=[0, 0, 5, 0, 0, 3.1])
    assert over[5] == pytest.approx(6.0 * (2 * np.pi - 6.2))


def test_steady_motion_is_fed_forward_with_the_vehicles_damping(lanes: Any) -> None:
    surge = tau(lanes, nu_d=[0.4, 0, 0, 0, 0, 0], nu=[0.4, 0, 0, 0, 0, 0])
    assert surge[0] == pytest.approx(13.7 * 0.4 + 141.0 * 0.16)


def test_output_is_limited(lanes: Any) -> None:
    assert np.abs(tau(lanes, eta_d=[100, 100, 100, 0, 0, 3])) == pytest.approx(
        [110, 110, 130, 0, 0, 18.0]
    )


def test_integral_does_not_wind_up_beyond_its_limit(lanes: Any) -> None:
    run = lanes(controller())
    for k in range(3000):
        run.step(k * H, H, eta_d=[50, 0, 5, 0, 0, 0], eta=AT)
    assert abs(run["z"][0]) <= 90.0
    released = [run.step((3000 + k) * H, H, eta_d=AT, eta=AT)["tau_d"][0] for k in range(100)]
    assert abs(released[-1]) <= 90.0


def test_integral_of_a_current_turns_with_the_vehicle(lanes: Any) -> None:
    """What was learnt heading north acts in the same direction of the world, heading east."""
    run = lanes(controller())
    for k in range(200):
        run.step(k * H, H, eta_d=[0.2, 0, 5, 0, 0, 0], eta=AT)
    force = run["z"][0]
    east = [0, 0, 5, 0, 0, np.pi / 2]
    made = run.step(200 * H, H, eta_d=east, eta=east)["tau_d"]
    assert force > 5.0
    assert made[:2] == pytest.approx([0.0, -force], abs=0.2)


def test_hull_is_held_on_its_place_in_a_current() -> None:
    """Controller and hull alone, Jacobi at 50 Hz, 0.4 m/s on the bow and then on the beam."""
    for v_c in ([-0.4, 0, 0], [0, 0.4, 0]):
        eta = held(v_c, 40.0)
        assert np.max(np.abs(eta[-1, :3] - AT[:3])) < 0.02
        assert np.max(np.abs(eta[:, 3:])) < 0.15


def held(v_c: Any, until: float) -> np.ndarray:
    """Rows of the hull's eta, of its true state and an ideal allocation."""
    hull, control = Evaluation(declare("bluerov2_heavy")), Evaluation(controller())
    p, p_c = hull.values_of("parameter", {}), control.values_of("parameter", {})
    d, d_c = hull.derived(p), control.derived(p_c)
    x, z = np.array(hull.initial(p, d)), np.array(control.initial(p_c, d_c))
    tau_d, none, rows = np.zeros(6), np.zeros(0), []
    for k in range(round(until / H)):
        u = hull.values_of("input", {"tau": tau_d, "v_c": v_c})
        y = np.array(hull.outputs(k * H, u, p, d, x, none)).ravel()
        u_c = control.values_of(
            "input", {"eta_d": AT, "nu_d": np.zeros(6), "eta": y[:6], "nu": y[10:16]}
        )
        z = np.array(control.updates[0](k * H, u_c, p_c, d_c, none, z, none))
        for part in range(2):
            t = (k + 0.5 * part) * H
            x = np.array(hull.rk4(t, 0.5 * H, u, u, u, p, d, x, none))
        tau_d = np.array(control.outputs(k * H, u_c, p_c, d_c, none, z)).ravel()
        rows.append(y[:6])
    return np.array(rows)
