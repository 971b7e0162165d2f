"""Where policies are put that were taught elsewhere: what is disturbed is what was asked for."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks.disturbed import LATE, NOISE, THRUST, Disturbed
from uuvsim_cosim.envs.tasks.evaluation import Evaluation, evaluate
from uuvsim_cosim.envs.tasks.pool_tracking import PoolTracking
from uuvsim_cosim.envs.tasks.scripted import scripted_policy
from uuvsim_cosim.envs.tasks.tracking_scenarios import transition_1
from uuvsim_cosim.envs.team_vector import CosimTeamVectorEnv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.paper.anticipation import Anticipating

N = 24


def judged(task: Disturbed | PoolTracking, late: tuple[float, float] | None = None) -> Evaluation:
    policy = scripted_policy(task)
    assert isinstance(policy, dict)
    if late is not None:
        policy = {agent: Anticipating(act, *late) for agent, act in policy.items()}
    return evaluate(task, policy, N, seed=7)


@pytest.fixture(scope="module")
def plain() -> float:
    return float(judged(Disturbed()).returns.mean())


def test_undisturbed_it_is_transition_1(plain: float) -> None:
    task = transition_1()
    same = evaluate(task, scripted_policy(task), N, seed=7)
    assert plain == pytest.approx(same.returns.mean(), rel=0.02)


def test_the_first_observation_is_of_the_start_before_anything_has_been_heard() -> None:
    firsts = []
    for task in (Disturbed(seen_late=0.4), transition_1()):
        env = CosimTeamVectorEnv(task, 4, autoreset_mode="Disabled")
        firsts.append(env.reset(seed=3)[0])
        env.close()
    np.testing.assert_allclose(firsts[0], firsts[1], atol=1e-6)


@pytest.mark.parametrize("late", [(0.4, 0.0), (0.0, 0.4), (0.4, 0.4)])
def test_anticipation_wins_back_what_delays_cost(plain: float, late: tuple[float, float]) -> None:
    task = Disturbed(seen_late=late[0], acted_late=late[1])
    raw, ahead = (judged(task, x).returns.mean() for x in (None, late))
    assert raw < 0.92 * plain
    assert ahead > 0.92 * plain


def test_what_is_randomised_is_drawn_within_its_limits_and_anew_for_each_episode() -> None:
    task = Disturbed(randomise=True)
    start = task.start(Draws(np.arange(200), np.zeros(200)))
    flow = start["tracker_1.thruster_1.Q_max"]
    assert np.ptp(flow**2) / np.max(flow**2) == pytest.approx(1 - THRUST[0] / THRUST[1], rel=0.1)
    for name, (low, high) in {
        "tracker_1.radio.delay": LATE,
        "tracker_1.positioning.delay": LATE,
    }.items():
        assert low <= start[name].min() < start[name].max() <= high
    assert NOISE[0] <= start["positioning.sigma"].min() < start["positioning.sigma"].max()
    assert len(np.unique(start["tracker_1.hull.D_q_11"])) == 200
    again = task.start(Draws(np.arange(200), np.zeros(200)))
    assert all(np.array_equal(start[k], again[k]) for k in start)


def test_in_the_pool_a_vehicle_tracks_another_on_its_own_estimates() -> None:
    done = judged(PoolTracking()).summary()
    assert done["track"] >= 0.95
    assert done["dist"] < 0.9


def test_wrong_options_are_refused() -> None:
    for make, options, said in (
        (Disturbed, {"seen_late": 0.5}, "seen_late.*0 to 0.4"),
        (Disturbed, {"thrust": 0.0}, "thrust"),
        (Disturbed, {"noise": float("nan")}, "noise"),
        (Disturbed, {"randomise": 1}, "expected True or False"),
        (Disturbed, {"nois": 0.1}, "nois.*expected one such as noise"),
        (PoolTracking, {"loss": 1.5}, "loss"),
        (PoolTracking, {"n_trackers": 2}, "the system's own"),
    ):
        with pytest.raises(InputInvalid, match=said):
            make(**options)
