"""Station keeping, trajectory following, disturbance rejection: reward, observation, start."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import uuvsim_cosim.envs  # noqa: F401  (registers the ids)
from tests.envs.tasks.moments import ArrayMoment
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks import (
    DisturbanceRejection,
    StationKeeping,
    TrajectoryFollowing,
    evaluate,
    scripted_policy,
)
from uuvsim_cosim.envs.tasks.coordinates import R_zyx, in_body, level, wrap
from uuvsim_cosim.envs.tasks.pose import PoseTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.shipped.tasks import ActedOn

Array = NDArray[np.float64]
TASKS: list[type[PoseTask]] = [StationKeeping, TrajectoryFollowing, DisturbanceRejection]


def a_moment(n: int = 30, width: int = 6, seed: int = 0, turn: float = 0.0) -> ArrayMoment:
    """Return random poses and a random reference; `turn` turns the world about D."""
    rng = np.random.default_rng(seed)
    Q = R_zyx(np.array([[0.0, 0.0, turn]]))[0]
    near = [1.0, 1.0, 1.0, 0.3, 0.3, 3.0]

    def pose() -> Array:
        eta = rng.uniform(-1, 1, (n, 6)) * near
        eta[:, :3] = eta[:, :3] @ Q.T
        eta[:, 5] += turn
        return eta

    ahead = rng.uniform(-1, 1, (n, 4, 3)) @ Q.T
    signals = {
        "hull.eta": pose(),
        "hull.nu": rng.uniform(-0.5, 0.5, (n, 6)),
        "current.v_c": rng.uniform(-0.5, 0.5, (n, 3)) @ Q.T,
        "ramps.v_c": rng.uniform(-0.5, 0.5, (n, 3)) @ Q.T,
        "faults.health": rng.uniform(0, 1, (n, 8)),
        "reference.eta_d": pose(),
        "reference.nu_d": rng.uniform(-0.5, 0.5, (n, 6)),
        "reference.ahead": ahead.reshape(n, 12),
    }
    return ArrayMoment(signals, {"agent": rng.uniform(-1, 1, (n, width))})


def test_rotations_are_orthogonal_and_turn_the_bow_to_its_heading() -> None:
    angles = np.random.default_rng(0).uniform(-1.5, 1.5, (50, 3))
    R = R_zyx(angles)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (50, 1, 1)), atol=1e-14)
    east = R_zyx(np.array([[0.0, 0.0, np.pi / 2]]))
    np.testing.assert_allclose(in_body(east, np.array([[0.0, 1.0, 0.0]])), [[1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(
        level(np.array([np.pi / 2]), np.array([[0.0, 1.0]])), [[1, 0]], atol=1e-15
    )
    np.testing.assert_allclose(
        in_body(R, R @ np.array([1.0, 2.0, 3.0])), np.tile([1, 2, 3], (50, 1))
    )


def test_an_angle_is_wrapped_into_half_a_turn_either_way() -> None:
    given = np.array([0.0, np.pi, -np.pi, 3 * np.pi, 7.0])
    np.testing.assert_allclose(wrap(given), [0, np.pi, np.pi, np.pi, 7 - 2 * np.pi])


def test_the_reward_is_one_at_the_goal_and_at_most_that_anywhere() -> None:
    task = StationKeeping()
    there = a_moment(1)
    at = dict(there.signals) | {"hull.eta": np.array([[0.0, 0.0, 10.0, 0.0, 0.0, 0.0]])}
    assert task.reward(ArrayMoment(at, {"agent": np.zeros((1, 6))}))[0] == 1.0
    far = dict(at) | {"hull.eta": np.array([[0.5, 0.0, 10.0, 0.0, 0.0, 0.0]])}
    assert task.reward(ArrayMoment(far, {"agent": np.zeros((1, 6))}))[0] == 0.5
    assert task.reward(ArrayMoment(at, {"agent": np.ones((1, 6))}))[0] == pytest.approx(0.95)
    anywhere = TrajectoryFollowing().reward(a_moment(500))
    assert np.all((anywhere >= -0.05) & (anywhere <= 1.0))


def test_turning_the_world_changes_neither_what_is_seen_nor_what_is_earned() -> None:
    task = TrajectoryFollowing(privileged=True)
    a, b = a_moment(), a_moment(turn=2.0)
    np.testing.assert_allclose(task.extra(a), task.extra(b), atol=1e-12)
    np.testing.assert_allclose(task.reward(a), task.reward(b), atol=1e-12)


@pytest.mark.parametrize("make", TASKS)
def test_one_row_of_a_thousand_is_what_one_environment_sees_and_earns(
    make: type[PoseTask],
) -> None:
    task, m = make(privileged=True), a_moment(1000)
    seen, earned = task.extra(m), task.reward(m)
    for i in (0, 7, 999):
        assert np.array_equal(task.extra(m.rows([i]))[0], seen[i])
        assert task.reward(m.rows([i]))[0] == earned[i]


@pytest.mark.parametrize("make", TASKS)
def test_a_start_depends_on_its_own_seed_and_episode_alone_and_is_within_the_region(
    make: type[PoseTask],
) -> None:
    task = make(randomise=True)
    draws = Draws(np.arange(200), np.full(200, 3))
    whole = task.start(draws)
    for i in (0, 11, 199):
        alone = task.start(draws.rows([i]))
        assert alone.keys() == whole.keys()
        assert all(np.array_equal(alone[k][0], whole[k][i]) for k in whole)
    wanted = whole.get("reference.origin", np.tile([0.0, 0.0, 10.0], (200, 1)))
    assert np.all(np.abs(whole["hull.eta_0"][:, :3] - wanted) <= 1.5)
    assert whole["hull.m"].std() > 0.1  # the hull is drawn too


def test_the_faults_drawn_are_at_most_as_many_as_asked_for_and_some_of_each_thruster() -> None:
    start = DisturbanceRejection(faults=2).start(Draws(np.arange(600), np.zeros(600, int)))
    weak = start["faults.efficiency"] < 1.0
    assert set(weak.sum(axis=1)) == {0, 1, 2}
    assert np.all(weak.mean(axis=0) > 0.05)
    assert np.all(start["faults.efficiency"][weak] <= 0.7)
    assert np.all(np.linalg.norm(start["ramps.dv"], axis=2) <= 0.3 + 1e-12)


@pytest.mark.parametrize("curve", ["lemniscate", "helix", "line"])
def test_the_reference_begins_where_the_vehicle_is_put_and_moves_at_its_speed(curve: str) -> None:
    task = TrajectoryFollowing(curves=(curve,), away=0.0, speed=(0.3, 0.3))
    simulation = TaskSimulation(task, 6)
    m = simulation.episodes.reset(seeds=range(6))
    np.testing.assert_allclose(m["reference.eta_d"][:, :3], m["hull.eta"][:, :3], atol=1e-12)
    off = wrap(m["reference.eta_d"][:, 5] - m["hull.eta"][:, 5])
    assert np.all(np.abs(off) <= 0.8 + 1e-9)
    assert m["reference.nu_d"][:, 0] == pytest.approx(0.3)
    ahead = m["reference.ahead"].reshape(6, 4, 3)
    for _ in range(5):
        m = simulation.act(np.zeros((6, 6)))
    np.testing.assert_allclose(m["reference.eta_d"][:, :3], ahead[:, 0], atol=1e-12)
    simulation.episodes.close()


@pytest.mark.parametrize("make", TASKS)
@pytest.mark.parametrize(
    "options",
    [{}, {"action": "velocity"}, {"observation": "navigation"}, {"randomise": True}],
    ids=["force", "velocity", "navigation", "randomised"],
)
def test_a_scripted_controller_does_well_and_a_random_one_does_not(
    make: type[PoseTask], options: dict[str, Any]
) -> None:
    task = make(**options)
    policy = scripted_policy(task)
    assert callable(policy)
    good = evaluate(task, policy, 16).summary()
    rng = np.random.default_rng(0)
    width = 4 if options.get("action") == "velocity" else 6
    bad = evaluate(task, lambda o: rng.uniform(-1, 1, (len(o), width)), 16).summary()
    assert good["return"] > 150.0  # of 200
    assert bad["return"] < 50.0
    assert good["position_error"] < 0.4


@pytest.mark.parametrize("action", ["force", "velocity"])
@pytest.mark.parametrize("vehicle", ["bluerov2", "desistek_saga", "rexrov"])
def test_the_scripted_controller_of_another_vehicle_uses_the_axes_that_it_controls(
    vehicle: str, action: ActedOn
) -> None:
    """One column for each action: bluerov2 has no pitch, desistek_saga surge, heave and yaw."""
    task = StationKeeping(vehicle=vehicle, action=action, current=(0.0, 0.0))
    policy = scripted_policy(task)
    assert callable(policy)
    held = evaluate(task, policy, 8).summary()
    left = evaluate(task, lambda o: np.zeros((len(o), len(task.actions))), 8).summary()
    assert held["return"] > 5.0 * left["return"]
    assert held["heading_error"] < 0.05
    if vehicle != "desistek_saga":  # nothing moves it sideways
        assert held["position_error"] < 0.2


@pytest.mark.parametrize("make", TASKS)
def test_a_privileged_observer_sees_the_water_and_what_was_drawn(make: type[PoseTask]) -> None:
    task = make(privileged=True, randomise=True)
    plain = make()
    drawn = len(task.randomisation.privileged_names)  # type: ignore[union-attr]
    more = 8 if make is DisturbanceRejection else 0
    assert len(task.extra_limits[0]) == len(plain.extra_limits[0]) + 3 + more + drawn
    simulation = TaskSimulation(task, 3)
    m = simulation.episodes.reset(seeds=[1, 2, 3])
    last = simulation.observe(m)[:, -drawn:]
    assert np.all(np.abs(last) <= 1.0)
    assert np.all(last.std(axis=0) > 0.0)
    simulation.episodes.close()


def test_who_strays_has_failed() -> None:
    m = a_moment(2)
    m.signals["hull.eta"][:, :3] = [[0.0, 0.0, 10.0], [0.0, 5.1, 10.0]]  # type: ignore[index]
    assert StationKeeping().terminated(m).tolist() == [False, True]


def test_the_eight_commands_can_be_acted_on_as_well() -> None:
    simulation = TaskSimulation(StationKeeping(action="thrusters"), 1)
    assert simulation.action_box.width == 8
    simulation.episodes.reset(seeds=[0])
    assert np.isfinite(simulation.observe(simulation.act(np.full((1, 8), 0.3)))).all()
    simulation.episodes.close()


@pytest.mark.parametrize("id", ["StationKeeping", "TrajectoryFollowing", "DisturbanceRejection"])
def test_the_ids_make_environments_of_one_and_of_many(id: str) -> None:
    env = gymnasium.make(f"uuvsim/{id}-v0", horizon=1, privileged=True)
    env.reset(seed=0)
    for k in range(10):
        *_, truncated, _ = env.step(env.action_space.sample())
        assert truncated is (k == 9)
    env.close()
    many = gymnasium.make_vec(f"uuvsim/{id}-v0", num_envs=3)
    assert type(many).__name__ == "CosimVectorEnv"
    many.close()


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (StationKeeping, {"action": "forces"}, "action 'forces'; expected one of force, thrusters"),
        (StationKeeping, {"action": ["force"]}, r"action \['force'\]; expected one of force"),
        (StationKeeping, {"observation": "x"}, "observation 'x'; expected one of truth, navig"),
        (
            StationKeeping,
            {"region": 0.0},
            r"region \[m\]: 0.0; expected a number of at least 1e-09",
        ),
        (StationKeeping, {"away": "far"}, r"away \[m\]: 'far'; expected a number of at least 0"),
        (
            StationKeeping,
            {"current": (0.3, 0.1)},
            r"current .*\(0.3, 0.1\); expected the least fir",
        ),
        (StationKeeping, {"current": 1}, r"current \[m/s\]: 1; expected \(least, greatest\)"),
        (StationKeeping, {"current": "fast"}, r"current \[m/s\]: 'fast'; expected \(least, gre"),
        (StationKeeping, {"privileged": "no"}, "privileged: 'no'; expected True or False"),
        (StationKeeping, {"randomisation": ["hull.m"]}, "expected a Randomisation"),
        (StationKeeping, {"awya": 1}, "StationKeeping: option 'awya'; expected one such as away"),
        (StationKeeping, {"xxx": 1}, "option 'xxx'; expected one of away, action, observation, "),
        (DisturbanceRejection, {"faults": 9}, "faults: 9; expected a whole number from 0 to 8"),
        (DisturbanceRejection, {"faults": 1.5}, "faults: 1.5; expected a whole number from 0 to 8"),
        (DisturbanceRejection, {"guts": 1}, "option 'guts'; expected one such as gust"),
        (TrajectoryFollowing, {"curves": ("circle",)}, r"\['circle'\]; expected some of lemnis"),
        (TrajectoryFollowing, {"curves": "line"}, "curves: 'line'; expected some of lemnis"),
        (TrajectoryFollowing, {"speed": 0.5}, r"speed \[m/s\]: 0.5; expected \(least, greatest\)"),
    ],
)
def test_wrong_options_are_refused_in_a_sentence(
    make: type[PoseTask], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputInvalid, match=message):
        make(**options)


def test_a_task_that_nobody_has_written_a_controller_for_is_refused() -> None:
    with pytest.raises(InputInvalid, match="StationKeeping: no scripted controller"):
        scripted_policy(StationKeeping(action="thrusters"))
