"""Evaluation: each episode counts to its end and no further, on seeds of its own."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.envs import Channel, FunctionTask
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.envs.tasks import (
    DisturbanceRejection,
    StationKeeping,
    TargetTracking,
    evaluate,
    scripted_policy,
)
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.shipped.tasks import task_system


def counting(limit: float = np.inf) -> FunctionTask:
    """Return 1 for each action; an episode ends after `limit` seconds, or those of its seed."""
    return FunctionTask(
        task_system(),
        actions=[Channel("allocation.tau_d", -10, 10)],
        observations=["hull.eta"],
        reward=lambda m: np.ones(m.n),
        terminated=lambda m: m.time >= np.minimum(limit, m.start["hull.eta_0"][:, 0]),
        start=lambda draws: {
            "hull.eta_0": np.column_stack(
                [np.ceil(draws.uniform("end", 0, 3)), np.zeros((draws.n, 5))]
            )
        },
        info=lambda m: {"seconds": m.time},
        action_step="0.5",
        horizon=2,
    )


def idle(observations: np.ndarray) -> np.ndarray:
    return np.zeros((len(observations), 6))


def test_the_return_is_that_of_one_episode_whatever_the_others_do() -> None:
    given = evaluate(counting(), idle, 30)
    ends = np.minimum(2.0, given.seconds)
    assert set(ends) == {1.0, 2.0}  # seeds differ, and the horizon cuts at 2 s
    assert np.array_equal(given.returns, 2 * ends)


def test_metrics_are_those_of_the_second_half() -> None:
    given = evaluate(counting(), idle, 30)
    expected = np.where(given.seconds == 1.0, 1.0, 1.75)  # of 0.5, 1 and of 0.5, 1, 1.5, 2
    np.testing.assert_allclose(given.metrics["seconds"], expected)


def test_equal_seeds_give_equal_episodes_in_any_number() -> None:
    task = StationKeeping(horizon=2)
    policy = scripted_policy(task)
    assert callable(policy)
    many, few = (evaluate(task, policy, n, seed=3).returns for n in (12, 2))
    assert np.array_equal(many[:2], few)
    assert not np.array_equal(evaluate(task, policy, 2, seed=4).returns, few)


def test_a_team_needs_a_policy_for_each_and_a_single_one_has_one() -> None:
    with pytest.raises(InputInvalid, match="a policy for each of tracker_1, tracker_2"):
        evaluate(TargetTracking(2, 0), idle, 1)
    with pytest.raises(InputInvalid, match="expected one policy"):
        evaluate(StationKeeping(), {"a": idle}, 1)
    with pytest.raises(InputInvalid, match="0 episodes; expected at least 1"):
        evaluate(StationKeeping(), idle, 0)


def test_a_team_s_return_is_the_mean_of_its_agents() -> None:
    task = TargetTracking(2, 0, rules={"credit": "own"})
    shared = TargetTracking(2, 0)
    policies = scripted_policy(task)
    own, team = (evaluate(t, policies, 4).returns for t in (task, shared))
    np.testing.assert_allclose(own, team)


@pytest.mark.parametrize(
    "task",
    [TargetTracking(2, 2, horizon=4), DisturbanceRejection(observation="navigation", horizon=2)],
    ids=["tracking", "disturbance"],
)
def test_a_master_gives_the_same_episode_to_the_last_bit(task: Task | TeamTask) -> None:
    policy = scripted_policy(task)
    kernel, master = (evaluate(task, policy, 1, backend=b) for b in ("kernel", "master"))  # type: ignore[arg-type]
    assert np.array_equal(kernel.returns, master.returns)
    assert all(np.array_equal(kernel.metrics[k], master.metrics[k]) for k in kernel.metrics)
