"""Every algorithm learns what has a closed form, is kept whole, and acts as its policy does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from uuvsim_cosim.learn.algorithms.checkpoint import load_checkpoint, save_checkpoint
from uuvsim_cosim.learn.algorithms.registry import ALGORITHMS, learner_of
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.policies.policy import Named, Policy
from uuvsim_cosim.learn.shared.errors import LearningDiverged

Array = NDArray[np.float32]
N = 8
WANTED = (0.5, -0.5)  # of agents 0 and 1: both stand in the grid of five levels
EVERY = tuple(ALGORITHMS)
VALUED = ("ppo", "ippo", "mappo", "dqn", "idqn")


def settings(name: str, **more: Any) -> dict[str, Any]:
    common = {"hidden": 16, "layers": 1, "lr": 1e-2, "batch": 64}
    if "ppo" in name:
        return common | {"samples": 160, "epochs": 4, "log_std": -1.0} | more
    return common | {"warm_up": 16, "buffer": 4000, "updates": 1.0} | more


def made(name: str, seed: int = 0, **more: Any) -> Any:
    agents = 1 if ALGORITHMS[name].alone else 2
    torch.set_num_threads(1)
    return learner_of(
        ALGORITHMS[name], settings(name, **more), agents=agents, observed=3, acted=1, n=N,
        seed=seed,
    )  # fmt: skip


def lived(
    learner: Any,
    steps: int,
    reward: Callable[[Array], Array],
    end: str = "truncated",
    seed: int = 0,
) -> list[Array]:
    """Live `steps` episodes of one step each; give the actions."""
    agents = 1 if ALGORITHMS[learner.name].alone else 2
    random = np.random.default_rng(seed)
    acts = []
    for _ in range(steps):
        seen = random.uniform(-1, 1, (N, agents, 3)).astype(np.float32)
        after = random.uniform(-1, 1, (N, agents, 3)).astype(np.float32)
        action = learner.act(seen)
        ended = np.full((N, agents), float(end == "terminated"), np.float32)
        learner.learn(
            Transitions(seen, action, reward(action).astype(np.float32), after, ended),
            np.ones(N, bool),
        )
        acts.append(action)
    return acts


def near(action: Array) -> Array:
    wanted = np.array(WANTED[: action.shape[1]])
    return np.asarray(-4.0 * (action[:, :, 0] - wanted) ** 2, np.float32)


@pytest.mark.parametrize("name", EVERY)
def test_each_agent_learns_the_action_that_its_own_reward_wants(name: str) -> None:
    more = {"epsilon_steps": 1000} if "dqn" in name else {}
    if name in ("sac", "masac", "isac"):
        more = {"alpha": 0.05, "tune_alpha": False, "warm_up": 400, "layers": 2}
    learner = made(name, **more)
    lived(learner, 250, near, "terminated")
    seen = np.random.default_rng(9).uniform(-1, 1, (64, learner_agents(learner), 3))
    action = learner.act(seen.astype(np.float32), explore=False).mean(axis=0)[:, 0]
    assert np.allclose(action, WANTED[: len(action)], atol=0.25)


def learner_agents(learner: Any) -> int:
    return 1 if ALGORITHMS[learner.name].alone else 2


@pytest.mark.parametrize("name", VALUED)
def test_an_episode_cut_short_is_worth_what_comes_after_and_an_ended_one_is_not(name: str) -> None:
    values = {}
    for end in ("truncated", "terminated"):
        learner = made(name, gamma=0.5, **({"tau": 0.2} if "dqn" in name else {}))
        lived(learner, 200, lambda a: np.ones(a.shape[:2], np.float32), end)
        values[end] = value_of(learner)
    assert values["terminated"] == pytest.approx(1.0, abs=0.1)  # r
    assert values["truncated"] == pytest.approx(2.0, abs=0.2)  # r / (1 - gamma)


@torch.no_grad()
def value_of(learner: Any) -> float:
    agents = learner_agents(learner)
    seen = torch.rand(32, agents, 3, generator=torch.Generator().manual_seed(1)) * 2 - 1
    if learner.name in ("dqn", "idqn"):
        return float(learner.network(seen.transpose(0, 1)).amax(-1).mean())
    return float(learner._values(seen).mean())


@pytest.mark.parametrize("name", EVERY)
def test_what_is_kept_in_a_file_goes_on_to_the_same_bits(name: str, tmp_path: Path) -> None:
    whole = made(name)
    lived(whole, 33, near, seed=1)  # PPO: with a part of its samples
    save_checkpoint(tmp_path / "c.pt", whole.state())
    other = made(name, seed=5)
    other.set_state(load_checkpoint(tmp_path / "c.pt"))
    one, two = (lived(x, 33, near, seed=2) for x in (whole, other))
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    for (k, a), b in zip(whole.tensors(0)[1].items(), other.tensors(0)[1].values(), strict=True):
        assert np.array_equal(a, b), k


@pytest.mark.parametrize("name", EVERY)
def test_its_policy_acts_as_it_does_without_exploring(name: str) -> None:
    learner = made(name)
    lived(learner, 30, near)
    agents = learner_agents(learner)
    seen = np.random.default_rng(3).uniform(-1, 1, (50, agents, 3)).astype(np.float32)
    for i in range(agents):
        kind, tensors = learner.tensors(i)
        named = tuple(Named(f"o[{k}]", -1, 1) for k in range(3))
        policy = Policy(kind, tensors, named, (Named("a", -1, 1),), "toy")  # type: ignore[arg-type]
        assert np.allclose(policy(seen[:, i]), learner.act(seen, explore=False)[:, i], atol=1e-5)


@pytest.mark.parametrize("name", EVERY)
def test_a_reward_that_is_no_number_stops_it(name: str) -> None:
    learner = made(name)
    with pytest.raises(LearningDiverged, match=r"(nan|inf); expected a finite number"):
        lived(learner, 60, lambda a: np.full(a.shape[:2], np.nan, np.float32))


def test_a_gradient_that_is_no_number_changes_nothing() -> None:
    learner = made("isac")
    lived(learner, 20, near)
    before = [w.detach().clone() for w in learner.masac.critic.weights]
    learner.masac.critic.weights[0].register_hook(lambda g: g * float("nan"))
    with pytest.raises(LearningDiverged, match=r"masac: the gradient of critic is nan"):
        lived(learner, 4, near)
    after = learner.masac.critic.weights
    assert all(torch.equal(a, b) for a, b in zip(before, after, strict=True))
