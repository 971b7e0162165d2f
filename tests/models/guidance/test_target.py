"""The target: constant speed, within the arena, heading by draws, by fear or along a path."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.guidance.target import MOTIONS, target

T = 0.02
ROOM = np.array([1.3, 2.4]) - 0.2


def moved(
    lanes: Any, steps: int, n: int = 1, motion: str = "random_heading", **options: Any
) -> Any:
    """Positions (steps, 2, n) and headings (steps, n)."""
    parameters = options.pop("parameters", {})
    run = lanes(target(motion, **options), n, seed=3, parameters=parameters)
    p, psi = np.zeros((steps, 2, n)), np.zeros((steps, n))
    for k in range(steps):
        run.step(k * T, T)
        p[k], psi[k] = run["p"].reshape(2, n), run["psi"].reshape(n)
    return p, psi


@pytest.mark.parametrize("motion", MOTIONS)
def test_speed_is_constant_and_the_arena_is_never_left(lanes: Any, motion: str) -> None:
    p, _ = moved(lanes, 4000, 16, motion, parameters={"psi_0": 0.9})
    assert np.all(np.abs(p) <= ROOM[:, None] + 1e-12)
    strides = np.linalg.norm(np.diff(p, axis=0), axis=1) / T
    assert np.max(strides) <= 0.15 + 1e-9
    assert np.mean(strides > 0.15 - 1e-9) > 0.99  # the others are mirrored within a step


def test_velocity_is_always_the_speed_along_the_heading() -> None:
    r = simulate(target(), until=60, h=T)
    np.testing.assert_allclose(np.linalg.norm(r["velocity"], axis=1), 0.15, rtol=1e-12)
    psi = r["eta"][:, 5]
    np.testing.assert_allclose(r["velocity"][:, 0], 0.15 * np.cos(psi), atol=1e-12)
    assert np.all(r["position"][:, 2] == 0.55)


def test_heading_is_smooth_but_at_walls(lanes: Any) -> None:
    p, psi = moved(lanes, 2000, 32)
    turn = np.abs((np.diff(psi, axis=0) + np.pi) % (2 * np.pi) - np.pi)
    near = np.any(np.abs(p[1:]) > ROOM[:, None] - 0.02, axis=1)
    assert np.max(turn[~near]) < 5 * 0.4 * T
    assert np.quantile(turn, 0.5) > 0.0


def test_equal_seeds_give_equal_paths_and_others_give_others() -> None:
    runs = [
        simulate(target(), until=30, h=T, parameters={"seed": s})["position"]
        for s in ((1, 2), (1, 2), (1, 3))
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.max(np.abs(runs[0] - runs[2])) > 0.1


def test_yaw_rate_has_its_deviation_from_the_start(lanes: Any) -> None:
    for steps in (6, 200):
        _, psi = moved(lanes, steps, 4000, parameters={"size": [1e3, 1e3, 1.1]})
        turn = (psi[-1] - psi[-2] + np.pi) % (2 * np.pi) - np.pi
        assert np.std(turn / T) == pytest.approx(0.4, rel=0.06)


def test_a_wall_mirrors_the_heading(lanes: Any) -> None:
    p, psi = moved(lanes, 800, 1, parameters={"psi_0": 0.3, "sigma_r": 0.0})
    assert psi[0, 0] == pytest.approx(0.3)
    first = int(np.argmax(np.abs(psi[:, 0] - 0.3) > 1e-6))
    assert p[first, 0, 0] == pytest.approx(ROOM[0], abs=0.15 * T)
    assert psi[first, 0] == pytest.approx(np.pi - 0.3)


def test_it_flees_the_nearest_tracker_and_heeds_none_that_is_far(lanes: Any) -> None:
    run = lanes(target("flee", trackers=2), parameters={"sigma_r": 0.0, "psi_0": 0.5})
    run.step(0.0, T, tracker_1=[9, 9, 0.5], tracker_2=[9, -9, 0.5])
    assert run["psi"] == pytest.approx([0.5])
    for k in range(1, 400):
        run.step(k * T, T, tracker_1=[0.3, 0.8, 0.5], tracker_2=[0, -0.4, 0.5])
    away = run["p"] - np.array([0.0, -0.4])
    other = run["p"] - np.array([0.3, 0.8])
    assert min(np.linalg.norm(away), np.linalg.norm(other)) > 0.6


def test_it_goes_from_waypoint_to_waypoint_and_round_again(lanes: Any) -> None:
    points = np.zeros((16, 2))
    points[:3] = [[0.8, 1.5], [-0.8, 1.0], [0.0, -1.5]]
    parameters = {"waypoints": points.ravel(), "count": 3}
    p, _ = moved(lanes, 6000, 1, "path", parameters=parameters)
    visits = [np.flatnonzero(np.linalg.norm(p[:, :, 0] - w, axis=1) < 0.25) for w in points[:3]]
    assert visits[0][0] < visits[1][0] < visits[2][0] < visits[0][-1]


def test_it_stays_out_of_obstacles(lanes: Any) -> None:
    table = np.array([[0.5, 0.8, 0.2, 1.0], [-0.6, -0.9, 0.15, 1.0], [0.0, 0.0, 0.0, 1.0]])
    p, _ = moved(lanes, 4000, 32, obstacles=3, parameters={"obstacles": table.ravel()})
    for x, y, r, _ in table[:2]:
        assert np.min(np.hypot(p[:, 0] - x, p[:, 1] - y)) > r + 0.2 - 3 * 0.15 * T
    assert np.all(np.abs(p) <= ROOM[:, None] + 1e-12)


def test_an_unknown_motion_and_too_many_trackers_are_refused() -> None:
    with pytest.raises(ParameterInvalid, match="'fle'; expected one of random_heading, flee"):
        target("fle")
    with pytest.raises(ParameterInvalid, match="9 trackers; expected 1 to 8"):
        target("flee", trackers=9)
