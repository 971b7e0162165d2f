from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.guidance.line_of_sight import guidance, lawn_mower

H = 0.02
SQUARE = [(10.0, 0.0, 5.0), (10.0, 6.0, 5.0), (0.0, 6.0, 7.0)]


def flown(lanes: Any, waypoints: Any, until: float, start: Any = (0, 0, 5, 0, 0, 0)) -> Any:
    """Rows of the outputs for a vehicle that is where it was wanted one step before."""
    run = lanes(guidance(waypoints=waypoints))
    eta = np.array(start, dtype=float)
    rows: dict[str, list[Any]] = {
        k: [] for k in ("eta_d", "nu_d", "waypoint", "done", "cross_track")
    }
    for k in range(round(until / H)):
        run.step(k * H, H, eta=eta)
        eta = run["eta_d"]
        for name, values in rows.items():
            values.append(run[name])
    return {name: np.squeeze(np.array(values)) for name, values in rows.items()}


def test_path_is_flown_to_its_end_and_held(lanes: Any) -> None:
    rows = flown(lanes, SQUARE, 120.0)
    assert rows["done"][-1] == 1
    assert rows["waypoint"][-1] == 3
    assert rows["eta_d"][-1, :3] == pytest.approx(SQUARE[-1], abs=1e-6)
    assert rows["nu_d"][-1] == pytest.approx([0] * 6, abs=1e-3)


def test_reference_passes_through_every_waypoint(lanes: Any) -> None:
    rows = flown(lanes, SQUARE, 120.0)
    for point in SQUARE:
        assert np.min(np.linalg.norm(rows["eta_d"][:, :3] - point, axis=1)) < 1e-6


def test_reference_is_continuous_and_no_faster_than_asked(lanes: Any) -> None:
    rows = flown(lanes, SQUARE, 120.0)
    steps = np.linalg.norm(np.diff(rows["eta_d"][:, :3], axis=0), axis=1)
    assert np.max(steps) <= 0.4 * H * (1 + 1e-9)


def test_wanted_velocity_is_the_derivative_of_the_wanted_position(lanes: Any) -> None:
    rows = flown(lanes, SQUARE, 120.0)
    psi = rows["eta_d"][1:, 5]
    v = np.diff(rows["eta_d"][:, :3], axis=0) / H
    u = np.cos(psi) * v[:, 0] + np.sin(psi) * v[:, 1]
    w = np.cos(psi) * v[:, 1] - np.sin(psi) * v[:, 0]
    body = np.stack([u, w, v[:, 2]], axis=1)
    error = np.abs(body - rows["nu_d"][1:, :3])
    assert np.quantile(error, 0.999) < 1e-6  # a leg's end falls within one step
    assert np.max(error) < 0.06


def test_yaw_rate_and_yaw_acceleration_stay_within_their_limits(lanes: Any) -> None:
    rows = flown(lanes, SQUARE, 120.0)
    r = rows["nu_d"][:, 5]
    assert np.max(np.abs(r)) <= 0.4 + 1e-9
    assert np.max(np.abs(np.diff(r))) <= 0.3 * H + 1e-9
    psi = np.unwrap(rows["eta_d"][:, 5])
    assert np.diff(psi) / H == pytest.approx(r[1:], abs=1e-9)


def test_bow_turns_the_shortest_way_through_south(lanes: Any) -> None:
    rows = flown(lanes, [(-10.0, -1.0, 5.0)], 12.0, (0, 0, 5, 0, 0, 3.0))
    psi = np.unwrap(rows["eta_d"][:, 5])
    assert psi[-1] == pytest.approx(2 * np.pi - np.pi + np.arctan2(1, 10), abs=1e-2)
    assert np.min(psi) > 2.9


def test_cross_track_is_the_distance_from_the_leg_to_starboard(lanes: Any) -> None:
    run = lanes(guidance(waypoints=[(20.0, 20.0, 5.0)]))
    run.step(0.0, H, eta=[0, 0, 5, 0, 0, 0])
    run.step(H, H, eta=[3.0, 5.0, 5, 0, 0, 0])
    assert run["cross_track"] == pytest.approx([2.0 / np.sqrt(2.0)], abs=1e-9)


def test_bow_looks_at_the_line_ahead(lanes: Any) -> None:
    run = lanes(guidance(waypoints=[(200.0, 0.0, 5.0)]))
    for k in range(3000):
        s = float(run["eta_d"][0]) if k else 0.0
        run.step(k * H, H, eta=[s, 0.5 if k else 0.0, 5, 0, 0, 0])
    assert run["eta_d"][5] == pytest.approx(-np.arctan(0.5 / 2.0), abs=1e-6)


def test_reference_waits_for_a_vehicle_that_cannot_follow(lanes: Any) -> None:
    run = lanes(guidance(waypoints=[(200.0, 0.0, 5.0)]))
    for k in range(3000):
        run.step(k * H, H, eta=[0, 0, 5, 0, 0, 0])
    stopped = float(run["eta_d"][0])
    assert 0.8 < stopped < 1.2
    assert run.step(60.0, H)["eta_d"][0] == stopped


def test_diving_straight_down_keeps_the_heading(lanes: Any) -> None:
    rows = flown(lanes, [(0.0, 0.0, 9.0)], 40.0, (0, 0, 5, 0, 0, 1.0))
    assert rows["done"][-1] == 1
    assert rows["eta_d"][:, 5] == pytest.approx(np.full(len(rows["done"]), 1.0))


def test_drifting_aside_while_diving_does_not_turn_the_bow(lanes: Any) -> None:
    run = lanes(guidance(waypoints=[(0.0, 0.0, 9.0), (10.0, 0.0, 9.0)]))
    for k in range(500):
        run.step(k * H, H, eta=[0, 0.5 if k else 0.0, 5 + 0.4 * k * H, 0, 0, 1.0])
    assert run["waypoint"] == 1
    assert run["eta_d"][5] == 1.0


def test_lawn_mower_goes_north_and_back() -> None:
    expected = [(0, 0, 5), (20, 0, 5), (20, 4, 5), (0, 4, 5)]
    assert lawn_mower(20.0, 4.0, 2, 5.0) == expected


def test_too_many_waypoints_are_refused() -> None:
    with pytest.raises(ParameterInvalid, match="33 waypoints; expected 1 to 32"):
        guidance(waypoints=[(float(i), 0.0, 5.0) for i in range(33)])
