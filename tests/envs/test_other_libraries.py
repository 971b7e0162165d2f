"""Whoever wants another library is served: the environments pass through three, as they are."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch

from uuvsim_cosim.envs import CosimEnv, CosimParallelEnv
from uuvsim_cosim.envs.sb3 import Sb3VecEnv
from uuvsim_cosim.envs.tasks.tracking_scenarios import source, transition_2


@pytest.fixture(autouse=True)
def _their_own_warnings() -> Iterator[None]:
    """Let those libraries warn of what they do themselves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def test_stable_baselines3_learns() -> None:
    from stable_baselines3 import SAC

    env = Sb3VecEnv(source(horizon=4), 4)
    model = SAC("MlpPolicy", env, learning_starts=20, batch_size=16, seed=0, device="cpu",
                policy_kwargs={"net_arch": [16]})  # fmt: skip
    model.learn(80)
    assert model._n_updates > 0
    env.close()


def test_torchrl_steps_a_team_through_its_pettingzoo_wrapper() -> None:
    from torchrl.envs import PettingZooWrapper

    ours = CosimParallelEnv(transition_2(horizon=4))
    env = PettingZooWrapper(ours, use_mask=False, seed=3)
    lived = env.rollout(10)
    seen_there = lived["tracker", "observation"].numpy()
    assert seen_there.shape == (10, 2, 31)
    other = CosimParallelEnv(transition_2(horizon=4))
    agents = other.possible_agents
    seen, _ = other.reset(seed=3)
    for _ in range(5):  # it resets more than once before an episode
        if np.array_equal(seen_there[0, 0], seen[agents[0]]):
            break
        seen, _ = other.reset()
    for k in range(10):
        for j, agent in enumerate(agents):
            assert np.array_equal(seen_there[k, j], seen[agent])
        acts = {a: lived["tracker", "action"][k, j].numpy() for j, a in enumerate(agents)}
        seen, rewards, *_ = other.step(acts)
        got = lived["next", "tracker", "reward"][k, :, 0].numpy()
        assert got == pytest.approx(list(rewards.values()), abs=1e-6)
    env.close()
    other.close()


def test_skrl_steps_one_and_a_team() -> None:
    from skrl.envs.wrappers.torch import wrap_env

    one: Any = wrap_env(CosimEnv(_solo()), wrapper="gymnasium", verbose=False)
    seen, _ = one.reset()
    assert seen.shape == (1, 31)
    seen, reward, terminated, truncated, _ = one.step(torch.zeros(1, 2))
    assert reward.shape == terminated.shape == truncated.shape == (1, 1)
    one.close()
    team: Any = wrap_env(CosimParallelEnv(transition_2(horizon=4)), wrapper="pettingzoo",
                         verbose=False)  # fmt: skip
    observations, _ = team.reset()
    assert set(observations) == set(team.possible_agents)
    for _ in range(3):
        acts = {a: torch.zeros(1, 2) for a in team.agents}
        observations, rewards, *_ = team.step(acts)
    assert all(rewards[a].numel() == 1 for a in team.possible_agents)
    assert {tuple(s.shape) for s in team.state().values()} == {(1, 14)}
    team.close()


def _solo() -> Any:
    from uuvsim_cosim.envs.solo import Solo

    return Solo(source(horizon=4))
