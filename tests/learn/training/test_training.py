"""A training learns, is kept whole, and goes on from there to the same bits."""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from uuvsim_cosim.envs.tasks.station_keeping import StationKeeping
from uuvsim_cosim.envs.tasks.tracking_scenarios import SCENARIOS
from uuvsim_cosim.envs.vector import CosimVectorEnv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.masac import Masac, MasacSettings
from uuvsim_cosim.learn.algorithms.off_policy_learner import MasacLearner, OffPolicySettings
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.learn.training.rollout import Rollout
from uuvsim_cosim.learn.training.train import train
from uuvsim_cosim.learn.training.training import Training
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED, MOST_ENVS, first_of_training

SMALL = MasacSettings(hidden=16)
SCHEDULE = OffPolicySettings(batch=16, buffer=600, warm_up=32, updates=1.0)


def training(
    folder: Path,
    steps: int,
    scenario: str = "transition_2",
    interrupted: Callable[[], bool] | None = None,
) -> Training:
    task = SCENARIOS[scenario](horizon=4)
    learner = MasacLearner(len(task.agents), 31, 2, seed=3, network=SMALL, schedule=SCHEDULE)
    return Training(
        task, learner, name=scenario, options={"horizon": 4}, n=8, seed=3, steps=steps,
        folder=folder, evaluate_every=200, evaluation_episodes=4, checkpoint_every=56,
        interrupted=interrupted,
    )  # fmt: skip


def bits(folder: Path) -> list[bytes]:
    names = ("policy-tracker_1.npz", "policy-tracker_2.npz", "evaluations.csv", "episodes.csv")
    return [(folder / name).read_bytes() for name in names]


def test_a_training_that_is_interrupted_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    torch.set_num_threads(1)
    whole = training(tmp_path / "whole", 400)
    whole.run()
    steps = iter(range(20))  # 168 of the environments: within an episode, ten actions of eight
    first = training(tmp_path / "parts", 400, interrupted=lambda: next(steps, None) is None)
    with pytest.raises(KeyboardInterrupt):
        first.run()
    assert first.step == 168
    again = training(tmp_path / "parts", 400)
    again.run()
    assert again.step == 400
    assert bits(tmp_path / "whole") == bits(tmp_path / "parts")


def test_what_was_learned_after_the_last_evaluation_is_judged_too(tmp_path: Path) -> None:
    short = training(tmp_path, 120)
    rows = short.run()
    assert [row["step"] for row in rows] == [0, 120]
    again = training(tmp_path, 120)
    assert again.run() == rows


def test_fewer_steps_than_were_trained_are_refused(tmp_path: Path) -> None:
    training(tmp_path, 120).run()
    training(tmp_path, 113).run()  # fifteen actions of eight, as 120
    with pytest.raises(
        InputInvalid, match=r"checkpoint\.pt: of step 120, 112 asked for;.*--restart"
    ):
        training(tmp_path, 112).run()


def test_a_refusal_leaves_the_folder_as_it_was(tmp_path: Path) -> None:
    def asked(steps: int) -> None:
        train(
            "source", folder=tmp_path, tensorboard=False, algorithm="sac", envs=8, steps=steps,
            evaluation_episodes=2, task_options={"horizon": 4},
            settings={"hidden": 16, "batch": 16, "warm_up": 32, "buffer": 200},
        )  # fmt: skip

    asked(128)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    with pytest.raises(InputInvalid, match="64 asked for"):
        asked(64)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before


def test_no_two_trainings_nor_evaluations_share_a_seed() -> None:
    ends = [(first_of_training(s), first_of_training(s) + MOST_ENVS) for s in (0, 1, 2, 999_999)]
    assert all(a[1] <= b[0] for a, b in itertools.pairwise(ends))
    assert ends[0][0] > JUDGING_SEED + 100_000_000
    assert ends[-1][1] < 2**63


def test_a_rollout_lives_again_what_episodes_of_different_lengths_were(tmp_path: Path) -> None:
    task = SCENARIOS["transition_1"](rules={"end_on_collision": True, "d_st": 0.8}, horizon=8)
    rollout, random = Rollout(task, 16, 0), np.random.default_rng(0)
    drawn = random.uniform(-1, 1, (60, 16, 1, 2)).astype(np.float32)
    for actions in drawn[:43]:
        rollout.step(actions)
    assert len(set(rollout.steps.tolist())) > 3  # they are out of step
    other = Rollout(task, 16, 99)
    other.set_state(rollout.state())
    assert np.array_equal(other.observation, rollout.observation)
    for actions in drawn[43:]:
        one, ended = rollout.step(actions)
        two, ended_too = other.step(actions)
        assert np.array_equal(one.after, two.after)
        assert np.array_equal(one.reward, two.reward)
        assert (ended is None) == (ended_too is None)
        if ended is not None and ended_too is not None:
            assert np.array_equal(ended.returns, ended_too.returns)
            assert np.array_equal(ended.metrics["dist"], ended_too.metrics["dist"])


def test_a_rollout_of_a_task_for_one_agent_is_what_its_vector_environment_gives() -> None:
    task = StationKeeping(horizon=2)
    rollout, env = Rollout(task, 4, 7), CosimVectorEnv(task, 4, autoreset_mode="Disabled")
    seen, _ = env.reset(seed=7)
    assert np.array_equal(rollout.observation[:, 0], seen)
    random = np.random.default_rng(0)
    returns = np.zeros(4)
    for _ in range(int(task.horizon / task.action_step)):
        actions = random.uniform(-1, 1, (4, 1, rollout.acted)).astype(np.float32)
        lived, ended = rollout.step(actions)
        seen, reward, terminated, _, _ = env.step(actions[:, 0])
        assert np.array_equal(lived.after[:, 0], seen)
        assert np.array_equal(lived.reward[:, 0], reward.astype(np.float32))
        assert np.array_equal(lived.terminated[:, 0], terminated)
        returns += reward
    assert ended is not None
    assert ended.returns == pytest.approx(returns, rel=1e-6)
    env.close()


def test_a_policy_acts_as_its_network_does(tmp_path: Path) -> None:
    masac = Masac(2, 31, 2, MasacSettings(hidden=32), 0)
    seen = np.random.default_rng(1).normal(size=(9, 2, 31)).astype(np.float32)
    trained = training(tmp_path, 8)
    expected = trained.learner.act(seen, explore=False)
    for i, policy in enumerate(trained.policies().values()):
        assert np.allclose(policy(seen[:, i]), expected[:, i], atol=1e-6)
        again = Policy.load(policy.save(tmp_path / f"{i}.npz"))
        assert np.array_equal(again(seen[:, i]), policy(seen[:, i]))
    assert masac.act(seen).shape == (9, 2, 2)


@pytest.mark.parametrize("cut", [10, 500])
def test_a_truncated_checkpoint_is_refused_in_words(tmp_path: Path, cut: int) -> None:
    first = training(tmp_path, 64)
    first.run()
    whole = first.checkpoint.read_bytes()
    first.checkpoint.write_bytes(whole[: len(whole) * cut // 1000])
    with pytest.raises(InputInvalid, match="expected a whole checkpoint"):
        training(tmp_path, 128).run()


@pytest.mark.parametrize("at", [0.3, 0.6])
def test_a_checkpoint_with_one_wrong_byte_is_refused_in_words(tmp_path: Path, at: float) -> None:
    first = training(tmp_path, 64)
    first.run()
    whole = bytearray(first.checkpoint.read_bytes())
    whole[int(len(whole) * at)] ^= 1
    first.checkpoint.write_bytes(whole)
    with pytest.raises(InputInvalid, match=r"checkpoint\.pt: .*damaged.*expected a whole"):
        training(tmp_path, 128).run()


def test_a_checkpoint_of_an_earlier_format_is_refused_with_what_to_do(tmp_path: Path) -> None:
    first = training(tmp_path, 64)
    first.run()
    old = torch.load(first.checkpoint, weights_only=True)
    torch.save({**old, "uuvsim_checkpoint": 1}, first.checkpoint)
    with pytest.raises(InputInvalid, match=r"format 1, written by another version.*--restart"):
        training(tmp_path, 128).run()


def test_a_lost_checkpoint_is_not_silently_begun_anew(tmp_path: Path) -> None:
    first = training(tmp_path, 64)
    first.run()
    first.checkpoint.unlink()
    with pytest.raises(InputInvalid, match=r"checkpoint\.pt: no such file, although curves"):
        training(tmp_path, 128).run()


def test_a_checkpoint_of_other_widths_is_refused_in_one_line(tmp_path: Path) -> None:
    first = training(tmp_path, 64)
    first.run()
    again = training(tmp_path, 128)
    other = MasacLearner(2, again.learner.masac.observed, 2, network=MasacSettings(hidden=8))
    again.learner = other
    with pytest.raises(InputInvalid, match=r"checkpoint\.pt: .*networks of these widths") as told:
        again.run()
    assert "\n" not in str(told.value)


def test_a_checkpoint_of_another_task_is_refused(tmp_path: Path) -> None:
    training(tmp_path, 64).run()
    with pytest.raises(InputInvalid, match="task 'transition_2'; expected 'target'"):
        training(tmp_path, 64, "target").run()
