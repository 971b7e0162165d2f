"""Target tracking as a task: observations, state (5), options, and the scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import uuvsim_cosim.envs  # noqa: F401  (registers the ids)
from tests.envs.tasks.moments import ArrayMoment
from uuvsim_cosim.envs.episodes.multi_agent import TeamSimulation
from uuvsim_cosim.envs.solo import Solo
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks import TargetTracking, evaluate, scripted_policy
from uuvsim_cosim.envs.tasks.tracking_scenarios import SCENARIOS
from uuvsim_cosim.envs.team import CosimParallelEnv
from uuvsim_cosim.errors import InputInvalid

Array = NDArray[np.float64]


def a_moment(task: TargetTracking, n: int = 20, seed: int = 0, turn: float = 0.0) -> ArrayMoment:
    """Return random poses; `turn` turns the world about D."""
    rng = np.random.default_rng(seed)
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, s], [-s, c]])

    def signals() -> dict[str, Array]:
        found: dict[str, Array] = {}
        for agent in task.agents:
            eta = rng.uniform(-1, 1, (n, 6)) * [1.1, 1.1, 0.0, 0.1, 0.1, 3.0]
            eta[:, :2] = eta[:, :2] @ R
            eta[:, 5] += turn
            found[f"{agent}.hull.eta"] = eta
            found[f"{agent}.hull.nu"] = rng.uniform(-0.4, 0.4, (n, 6))
            found[f"{agent}.pilot.nu_d"] = rng.uniform(-0.4, 0.4, (n, 6))
        target = rng.uniform(-1.1, 1.1, (n, 3))
        target[:, :2] = target[:, :2] @ R
        found["target.position"] = target
        return found

    earlier, now = signals(), signals()
    table = np.concatenate(
        [rng.uniform(-1.1, 1.1, (n, task.n_obstacles, 2)) @ R,
         rng.uniform(0.1, 0.2, (n, task.n_obstacles, 1)),
         rng.uniform(0.3, 1.1, (n, task.n_obstacles, 1))], axis=2)  # fmt: skip
    start = {"target.obstacles": table}
    return ArrayMoment(now, {}, start, ArrayMoment(earlier, {}, start))


def renamed(m: ArrayMoment, order: Mapping[str, str]) -> ArrayMoment:
    """Return the moment with vehicles exchanged."""

    def own(signals: Mapping[str, Array]) -> dict[str, Array]:
        return {".".join([order.get(k.split(".")[0], k.split(".")[0]), *k.split(".")[1:]]): v
                for k, v in signals.items()}  # fmt: skip

    before = ArrayMoment(own(m.before.signals), {}, m.start)
    return ArrayMoment(own(m.signals), {}, m.start, before)


def test_turning_the_world_changes_what_is_seen_of_the_arena_alone() -> None:
    task = TargetTracking(3, 2)
    a, b = (task.observe(a_moment(task, turn=t)) for t in (0.0, 1.2))
    arena = 4  # N, E, cos and sin of heading
    for agent in task.agents:
        np.testing.assert_allclose(a[agent][:, arena:], b[agent][:, arena:], atol=1e-12)
        assert np.abs(a[agent][:, :arena] - b[agent][:, :arena]).max() > 0.1


def test_exchanging_vehicles_exchanges_what_they_see_and_leaves_the_others_view() -> None:
    task = TargetTracking(3, 2)
    m = a_moment(task)
    swapped = renamed(m, {"tracker_1": "tracker_2", "tracker_2": "tracker_1"})
    a, b = task.observe(m), task.observe(swapped)
    assert np.array_equal(a["tracker_1"], b["tracker_2"])
    assert np.array_equal(a["tracker_2"], b["tracker_1"])
    assert np.array_equal(a["tracker_3"], b["tracker_3"])
    assert np.array_equal(task.reward(m)["tracker_1"], task.reward(swapped)["tracker_2"])


def test_one_row_of_a_thousand_is_what_one_environment_sees_and_earns() -> None:
    task = TargetTracking(2, 2)
    m = a_moment(task, 1000)
    for i in (0, 3, 999):
        one = m.rows([i])
        for agent in task.agents:
            assert np.array_equal(task.observe(one)[agent][0], task.observe(m)[agent][i])
            assert task.reward(one)[agent][0] == task.reward(m)[agent][i]
        assert np.array_equal(task.state(one)[0], task.state(m)[i])


def test_observations_are_equally_wide_in_all_scenarios_and_padded_with_zeros() -> None:
    tasks = {name: make() for name, make in SCENARIOS.items()}
    assert {len(t.limits(t.agents[0])[0]) for t in tasks.values()} == {31}
    alone = tasks["transition_1"]
    seen = alone.observe(a_moment(alone))["tracker_1"]
    assert np.all(seen[:, 14:] == 0.0)
    assert np.all(seen[:, 8] == 1.0)  # the target is known
    two = tasks["target"].observe(a_moment(tasks["target"], seed=3))["tracker_2"]
    assert np.all(two[:, 14] == 1.0)  # the other tracker is there
    reached = a_moment(tasks["target"], seed=3).start["target.obstacles"][:, :, 3] >= 0.55
    assert np.array_equal(two[:, [21, 26]].sum(axis=1), reached.sum(axis=1))  # the tall ones


def test_what_is_ahead_and_to_starboard_is_seen_there() -> None:
    task = TargetTracking(1, 0)
    m = a_moment(task, 1)
    m.signals["tracker_1.hull.eta"][0] = [0.0, 1.0, 0.5, 0.0, 0.0, np.pi / 2]  # type: ignore[index]
    m.signals["target.position"][0] = [-0.5, 2.0, 0.5]  # type: ignore[index]  # starboard: south
    seen = task.observe(m)["tracker_1"][0]
    assert seen[8:12] == pytest.approx([1.0, 1.0, 0.5, np.hypot(1.0, 0.5)])


def test_a_target_out_of_range_is_not_seen_at_all() -> None:
    near, far = TargetTracking(1, 0, knowledge_range=9.0), TargetTracking(1, 0, knowledge_range=0.1)
    m = a_moment(near)
    assert np.all(near.observe(m)["tracker_1"][:, 8] == 1.0)
    assert np.all(far.observe(m)["tracker_1"][:, 8:14] == 0.0)


def test_the_state_is_that_of_equation_5() -> None:
    task = TargetTracking(2, 1)
    m = a_moment(task, 4)
    state = task.state(m)
    assert state.shape == (4, 3 * 2 + 3 * 2 + 2 + 4)
    assert np.array_equal(state[:, 3:6], m["tracker_2.hull.eta"][:, [0, 1, 5]])
    assert np.array_equal(state[:, 6:9], m["tracker_1.hull.nu"][:, [0, 1, 5]])
    assert np.array_equal(state[:, 12:14], m["target.position"][:, :2])
    assert np.array_equal(state[:, 14:], m.start["target.obstacles"][:, 0])
    world = TargetTracking(2, 1, frame="world").state(m)
    assert np.hypot(world[:, 6], world[:, 7]) == pytest.approx(np.hypot(state[:, 6], state[:, 7]))
    psi, v = state[:, 2], state[:, 6:8]
    assert world[:, 6] == pytest.approx(np.cos(psi) * v[:, 0] - np.sin(psi) * v[:, 1])


def test_a_collision_ends_an_episode_only_if_that_is_asked_for() -> None:
    ends = TargetTracking(2, 0, rules={"end_on_collision": True})
    m = a_moment(ends)
    m.signals["tracker_2.hull.eta"][0, :2] = m.signals["tracker_1.hull.eta"][0, :2] + 0.1  # type: ignore[index]
    assert ends.terminated(m)["tracker_1"][0]
    assert ends.terminated(m)["tracker_2"][0]
    assert not TargetTracking(2, 0).terminated(m)["tracker_1"].any()


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_a_scripted_team_does_well_and_a_random_one_does_not(name: str) -> None:
    task = SCENARIOS[name]()
    good = evaluate(task, scripted_policy(task), 32).summary()
    rng = np.random.default_rng(0)
    chance = {a: lambda o: rng.uniform(-1, 1, (len(o), 2)) for a in task.agents}
    bad = evaluate(task, chance, 32).summary()
    assert good["track"] > 0.97
    assert good["viol"] < 0.05
    assert good["return"] > bad["return"] + 60.0


OPTIONS: list[dict[str, Any]] = [
    {"n_trackers": 1, "motion": "flee"},
    {"n_trackers": 1, "motion": "path"},
    {"n_trackers": 2, "vehicle": "bluerov2_heavy"},
    {"n_trackers": 2, "delay": 0.2, "noise": 0.007, "loss": 0.1},
    {"n_trackers": 2, "n_obstacles": 1, "profile": "table1"},
    {"n_trackers": 8, "arena": (6.0, 6.0, 1.1)},
]


@pytest.mark.parametrize("options", OPTIONS, ids=lambda o: "-".join(map(str, o.values())))
def test_every_option_runs_with_finite_numbers_within_the_limits(options: dict[str, Any]) -> None:
    task = TargetTracking(**options)
    simulation = TeamSimulation(task, 4)
    simulation.reset(seeds=[1, 2, 3, 4])
    policies = scripted_policy(task)
    assert isinstance(policies, Mapping)
    for _ in range(10):
        seen = simulation.now.observation
        now = simulation.act({a: policies[a](seen[a]) for a in task.agents})
        assert np.isfinite(now.reward).all()
        assert all(simulation.spaces[a].contains(now.observation[a][0]) for a in task.agents)
    assert simulation.state_space.contains(simulation.state()[0])
    simulation.episodes.close()


def test_links_that_are_late_show_where_the_target_was_and_the_start_before() -> None:
    late, sharp = TargetTracking(1, 0, delay=0.4), TargetTracking(1, 0)
    assert "positioning.y" in late.signals
    assert "positioning.y" not in sharp.signals
    simulation, other = TeamSimulation(late, 1), TeamSimulation(sharp, 1)
    simulation.reset(seeds=[5])
    other.reset(seeds=[5])
    first, known = (s.now.observation["tracker_1"] for s in (simulation, other))
    assert np.array_equal(first, known)
    other.episodes.close()
    for _ in range(4):
        m = simulation.act({"tracker_1": np.zeros((1, 2))}).moment
    behind = m["positioning.y"][0, :2] - m["target.position"][0, :2]
    assert np.hypot(*behind) == pytest.approx(0.15 * 0.4, rel=0.4)
    simulation.episodes.close()


def test_with_two_trackers_the_ids_are_one_central_agent_and_the_task_a_parallel_environment() -> (
    None
):
    env = gymnasium.make("uuvsim/TargetTrackingTarget-v0")
    seen, _ = env.reset(seed=1)
    assert env.action_space.shape == (4,)
    assert env.observation_space.contains(seen)
    _, _, terminated, truncated, info = env.step(np.zeros(4, np.float32))
    assert {"track", "dist", "viol", "clean"} <= info.keys()
    assert not terminated
    assert not truncated
    env.close()
    team = CosimParallelEnv(SCENARIOS["target"]())
    observations, _ = team.reset(seed=1)
    assert np.array_equal(observations["tracker_2"], seen[31:62])
    team.close()


@pytest.mark.parametrize("id", ["Source", "Transition1", "Transition2", "Target", ""])
def test_an_episode_is_fifty_actions(id: str) -> None:
    env = gymnasium.make_vec(f"uuvsim/TargetTracking{id}-v0", num_envs=2)
    assert type(env).__name__ == "CosimVectorEnv"
    env.reset(seed=0)
    for k in range(50):
        _, _, terminated, truncated, _ = env.step(np.zeros(env.action_space.shape, np.float32))
        assert not terminated.any()
        assert truncated.all() == (k == 49)
    env.close()


def test_the_start_values_of_all_parts_agree() -> None:
    task = TargetTracking(2, 2)
    start = task.start(Draws(np.arange(5), np.zeros(5, int)))
    assert np.array_equal(start["target.obstacles"], start["tracker_2.pool.obstacles"])
    assert np.all(start["tracker_1.hull.eta_0"][:, 2] == start["target.position_0"][:, 2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_trackers": 0}, "n_trackers: 0; expected a whole number from 1 to 8"),
        ({"n_trackers": 1.5}, "n_trackers: 1.5; expected a whole number from 1 to 8"),
        ({"n_trackers": "2"}, "n_trackers: '2'; expected a whole number from 1 to 8"),
        ({"n_obstacles": -1}, "n_obstacles: -1; expected a whole number from 0 to 64"),
        (
            {"n_trackers": 3, "slots": (1, 2)},
            "slots, other trackers: 1; expected a whole .* from 2",
        ),
        ({"slots": 0}, r"slots: 0; expected two numbers, .* at least \(1, 0\)"),
        ({"knowledge_range": -1}, r"knowledge_range \[m\]: -1; expected a number of at least 0"),
        ({"vehicle": "pool9"}, "vehicle 'pool9'; expected one of pool8, bluerov2_heavy"),
        ({"motion": "sleep"}, "motion 'sleep'; expected one of random_heading, flee, path, rest"),
        ({"delay": 0.5}, r"delay \[s\]: 0.5; expected a number, 0 to 0.4"),
        ({"loss": 2}, "loss: 2; expected a number, 0 to 1"),
        ({"noise": float("nan")}, r"noise \[m\]: nan; expected a number of at least 0"),
        ({"frame": "moon"}, "frame 'moon'; expected one of body, world"),
        ({"arena": (2.6, 4.8)}, r"arena \[m\]: \(2.6, 4.8\); expected \(N, E, D\)"),
        ({"profile": "paper"}, "profile 'paper'; expected one of default, table1"),
        ({"rules": {"w_p": "a"}}, "rules, w_p: 'a'; expected a number"),
        ({"rules": {"edges": "near"}}, "rules, edges 'near'; expected one of range, exponential"),
        ({"rules": {"end_on_collision": 1}}, "rules, end_on_collision: 1; expected True or False"),
        ({"rules": 3}, "rules: 3; expected values by name"),
        ({"trackers": 3}, "TargetTracking: option 'trackers'; expected one such as n_trackers"),
    ],
)
def test_wrong_options_are_refused_in_a_sentence(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputInvalid, match=message):
        TargetTracking(**options)


def test_a_scenario_says_which_options_there_are() -> None:
    with pytest.raises(InputInvalid, match="option 'motoin'; expected one such as motion"):
        SCENARIOS["target"](motoin="flee")
    with pytest.raises(InputInvalid, match="option 'motoin'; expected one such as motion"):
        gymnasium.make("uuvsim/TargetTrackingTarget-v0", motoin="flee")


def test_trackers_are_given_their_teams_reward_unless_each_has_its_own() -> None:
    assert TargetTracking(2).team_reward
    assert not TargetTracking(2, rules={"credit": "own"}).team_reward


def test_one_central_agent_earns_what_each_of_its_trackers_earns() -> None:
    task = TargetTracking(2)
    m = ArrayMoment(a_moment(task).signals, {"": np.zeros((20, 4))}, {}, a_moment(task, seed=1))
    assert np.array_equal(Solo(task).reward(m), task.reward(m)["tracker_1"])
