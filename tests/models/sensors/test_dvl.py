from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import q_of_euler
from uuvsim_cosim.models.sensors.dvl import dvl

TILT = np.deg2rad(22.5)


def ping(lanes: Any, silent: Any, extra: Any = None, n: int = 1, **inputs: Any) -> Any:
    m = dvl()
    still = silent(m) | {"bottom_depth": 20.0, "r_s": [0, 0, 0]} | dict(extra or {})
    return lanes(m, n, parameters=still).step(0.0, 0.2, **{"eta": [0, 0, 5, 0, 0, 0]} | inputs)


def q(phi: float, theta: float, psi: float) -> np.ndarray:
    return np.array(ca.DM(q_of_euler(phi, theta, psi))).ravel()


def test_range_on_a_level_hull_is_height_over_cosine_of_the_tilt(lanes: Any, silent: Any) -> None:
    run = ping(lanes, silent)
    assert run["range"] == pytest.approx([15.0 / np.cos(TILT)] * 4, abs=1e-12)
    assert run["altitude"] == pytest.approx([15.0], abs=1e-12)


def test_rolled_to_starboard_the_port_beam_reaches_farther(lanes: Any, silent: Any) -> None:
    phi = 0.2
    run = ping(lanes, silent, {"azimuth": np.deg2rad([0, 90, 180, 270])}, q=q(phi, 0, 0))
    expected = [15 / np.cos(TILT) / np.cos(phi), 15 / np.cos(TILT - phi)]
    assert run["range"][[0, 1]] == pytest.approx(expected, abs=1e-12)
    assert run["range"][3] == pytest.approx(15 / np.cos(TILT + phi), abs=1e-12)


def test_beam_velocity_is_positive_towards_where_the_beam_points(lanes: Any, silent: Any) -> None:
    forward = np.sin(TILT) * np.sqrt(0.5)
    run = ping(lanes, silent, nu=[1.0, 0, 0, 0, 0, 0])
    assert run["beam_velocity"] == pytest.approx([forward, -forward, -forward, forward], abs=1e-12)


def test_velocity_is_that_of_the_place_where_it_sits(lanes: Any, silent: Any) -> None:
    nu, r = np.array([0.5, -0.2, 0.1, 0.3, -0.1, 0.4]), np.array([-0.4, 0.2, 0.3])
    run = ping(lanes, silent, {"r_s": r}, nu=nu)
    assert run["velocity"] == pytest.approx(nu[:3] + np.cross(nu[3:], r), abs=1e-8)
    assert run["valid"] == 1.0


def test_mounting_does_not_change_the_velocity_in_body_axes(lanes: Any, silent: Any) -> None:
    run = ping(lanes, silent, {"Theta_s": [0.1, -0.2, 0.8]}, nu=[0.5, -0.2, 0.1, 0, 0, 0])
    assert run["velocity"] == pytest.approx([0.5, -0.2, 0.1], abs=1e-8)


def test_three_beams_still_give_the_velocity(lanes: Any, silent: Any) -> None:
    """Rolled so far that one beam is flatter than the limit."""
    run = ping(
        lanes,
        silent,
        {"azimuth": np.deg2rad([0, 90, 180, 270]), "incidence_max": 0.8},
        q=q(0.5, 0, 0),
        nu=[0.5, 0.3, -0.1, 0, 0, 0],
    )
    assert list(run["beam_valid"]) == [1, 1, 1, 0]
    assert run["velocity"] == pytest.approx([0.5, 0.3, -0.1], abs=1e-7)


def test_too_high_above_the_bottom_nothing_is_valid_and_values_hold(
    lanes: Any, silent: Any
) -> None:
    run = ping(lanes, silent, nu=[0.5, 0, 0, 0, 0, 0])
    run.step(0.2, 0.2, eta=[0, 0, -40, 0, 0, 0], nu=[0.9, 0, 0, 0, 0, 0])
    assert list(run["beam_valid"]) == [0, 0, 0, 0]
    assert run["valid"] == 0.0
    assert run["velocity"] == pytest.approx([0.5, 0, 0], abs=1e-8)
    assert run["altitude"] == pytest.approx([15.0])
    assert run["t_sample"] == pytest.approx([0.2])


def test_upside_down_it_hears_nothing_and_stays_finite(lanes: Any, silent: Any) -> None:
    run = ping(lanes, silent, q=q(np.pi, 0, 0))
    assert list(run["beam_valid"]) == [0, 0, 0, 0]
    assert np.all(np.isfinite(run.y))
    assert np.all(np.isfinite(run.z))


def test_beams_are_lost_as_often_as_stated(lanes: Any, silent: Any) -> None:
    run = ping(lanes, silent, {"dropout": 0.2}, n=4000)
    share = 1.0 - np.mean(run["beam_valid"], axis=1)
    assert share == pytest.approx([0.2] * 4, abs=4.5 * np.sqrt(0.2 * 0.8 / 4000))


def test_velocity_noise_is_that_of_four_beams(lanes: Any, silent: Any) -> None:
    run = ping(lanes, silent, {"sigma_v": 0.01}, n=4000)
    level = 0.01 / np.sqrt(2) / np.sin(TILT)
    expected = [level, level, 0.01 / 2 / np.cos(TILT)]
    assert np.std(run["velocity"], axis=1) == pytest.approx(expected, rel=0.06)


# ---- water track, and pings by range ------------------------------------------------------------


def through(lanes: Any, silent: Any, height: float, **inputs: Any) -> Any:
    m = dvl("a50", track="both")
    still = silent(m) | {"bottom_depth": 5.0 + height, "r_s": [0, 0, 0]}
    return lanes(m, parameters=still).step(0.0, 0.2, eta=[0, 0, 5, 0, 0, 0], **inputs)


def test_water_track_sees_the_velocity_through_the_water(lanes: Any, silent: Any) -> None:
    east = q(0, 0, np.pi / 2)
    run = through(lanes, silent, 15.0, q=east, nu=[0.5, 0, 0, 0, 0, 0], v_c=[0.1, 0.2, 0])
    assert run["velocity_water"] == pytest.approx([0.3, 0.1, 0], abs=1e-8)
    assert run["velocity"] == pytest.approx([0.5, 0, 0], abs=1e-8)
    assert run["valid_water"] == 1.0


@pytest.mark.parametrize(("height", "valid"), [(5.5, 0.0), (5.7, 1.0), (900.0, 1.0)])
def test_water_track_needs_its_layer_clear_of_the_bottom_and_no_bottom(
    lanes: Any, silent: Any, height: float, valid: float
) -> None:
    assert through(lanes, silent, height)["valid_water"] == valid


@pytest.mark.parametrize(
    ("height", "pings"),
    [(2.0, 26), (20.0, 26), (40.0, 18), (200.0, 4)],  # of 2 · 40 / cos(tilt) / 1500 = 0.058 s
)
def test_pings_follow_the_range(lanes: Any, silent: Any, height: float, pings: int) -> None:
    m = dvl("a50", period="0.0005", aperiodic=True)
    still = silent(m) | {"bottom_depth": 5.0 + height, "r_s": [0, 0, 0]}
    run = lanes(m, parameters=still)
    times = set()
    for k in range(200):
        run.step(0.005 * k, 0.005, eta=[0, 0, 5, 0, 0, 0])
        times.add(float(run["t_sample"][0]))
    assert len(times) == pings


def test_a_track_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="track = 'watre'; expected bottom or both"):
        dvl(track="watre")
