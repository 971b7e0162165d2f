"""At the switch from one task to the next, actions are exactly unchanged."""

from typing import Any

import numpy as np
import pytest
import torch

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.masac import Masac, MasacSettings
from uuvsim_cosim.learn.algorithms.registry import TRANSFERS, algorithm_for, learner_of
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.algorithms.transfer import transfer


@pytest.mark.parametrize(("old", "new"), [(1, 1), (1, 2), (2, 2), (2, 3), (1, 3), (3, 2)])
@pytest.mark.parametrize("central", [True, False])
def test_actions_are_exactly_unchanged_whatever_wakes_up(old: int, new: int, central: bool) -> None:
    last = Masac(old, 31, 2, MasacSettings(hidden=64, central=central), 0)
    awake = np.arange(31) < 14
    given = transfer(last, new, awake, seed=1)
    random = np.random.default_rng(0)
    seen = random.normal(size=(50, new, 31)).astype(np.float32)
    asleep = np.where(awake, seen, 0).astype(np.float32)
    for i in range(new):
        before = np.zeros((50, old, 31), np.float32)
        before[:, i % old] = asleep[:, i]
        expected = last.act(before, explore=False)[:, i % old]
        assert np.array_equal(given.act(seen, explore=False)[:, i], expected)


def test_values_of_a_team_of_one_are_those_of_each_in_a_team_of_two() -> None:
    last = Masac(1, 5, 2, MasacSettings(hidden=32), 0)
    given = transfer(last, 2, np.ones(5, bool), seed=1)
    random = torch.Generator().manual_seed(2)
    o, a = torch.randn(2, 7, 5, generator=random), torch.randn(2, 7, 2, generator=random)
    both = given._q(given.critic, given._seen(o, a))
    for i in range(2):
        alone = last._q(last.critic, last._seen(o[i : i + 1], a[i : i + 1]))
        assert torch.equal(both[i], alone[0])


# ---- every algorithm that goes on ---------------------------------------------------------

SEEN, AWAKE = 6, np.arange(6) < 4


def made(name: str, agents: int, seed: int, hidden: int = 16) -> Any:
    given: dict[str, Any] = {"hidden": hidden, "layers": 2, "batch": 16}
    given |= {"samples": 64} if "ppo" in name else {"warm_up": 16, "buffer": 500}
    return learner_of(
        algorithm_for(name, agents), given, agents=agents, observed=SEEN, acted=1, n=8, seed=seed
    )


def taught(name: str, agents: int, seed: int = 0) -> Any:
    """A learner that has lived 12 steps of 8 environments, the last inputs always zero."""
    learner, random = made(name, agents, seed), np.random.default_rng(seed)
    for _ in range(12):
        o, after = (
            np.where(AWAKE, random.normal(size=(8, agents, SEEN)), 0.0).astype(np.float32)
            for _ in range(2)
        )
        reward = random.normal(size=(8, agents)).astype(np.float32)
        learner.learn(
            Transitions(o, learner.act(o), reward, after, np.zeros((8, agents), np.float32)),
            np.zeros(8, bool),
        )
    return learner


@pytest.mark.parametrize("name", TRANSFERS)
@pytest.mark.parametrize(("old", "new"), [(1, 2), (2, 2), (2, 3), (3, 2)])
def test_every_algorithm_acts_as_before_at_a_switch(name: str, old: int, new: int) -> None:
    last, given = taught(name, old), made(name, new, 7)
    given.go_on_from(last, 7)
    random = np.random.default_rng(3)
    seen = random.normal(size=(40, new, SEEN)).astype(np.float32)
    before = np.zeros((40, old, SEEN), np.float32)
    for i in range(new):
        before[:, i % old] = np.where(AWAKE, seen[:, i], 0)
        expected = last.act(before, explore=False)[:, i % old]
        assert np.allclose(given.act(seen, explore=False)[:, i], expected, atol=1e-7, rtol=0)


@pytest.mark.parametrize("name", ["ippo", "mappo"])
def test_values_and_deviations_of_ppo_go_on_too(name: str) -> None:
    last, given = taught(name, 1), made(name, 2, 7)
    with torch.no_grad():
        last.log_std.fill_(-1.5)
    given.go_on_from(last, 7)
    seen = torch.randn(9, 2, SEEN, generator=torch.Generator().manual_seed(0))
    asleep = torch.where(torch.from_numpy(AWAKE), seen, 0.0)
    with torch.no_grad():
        for i in range(2):
            expected = last._values(asleep[:, i : i + 1])[:, 0]
            assert torch.allclose(given._values(seen)[:, i], expected, atol=1e-6)
    assert torch.equal(given.log_std, torch.full((2, 1, 1), -1.5))


def test_what_ppo_has_seen_is_kept_in_its_file() -> None:
    last, again = taught("ippo", 1), made("ippo", 1, 5)
    again.set_state(last.state())
    assert np.array_equal(again._awake, AWAKE)
    before = {k: v for k, v in last.state().items() if k != "awake"}  # files of earlier versions
    again.set_state(before)
    assert again._awake.all()


def test_after_a_switch_nobody_acts_at_random_again() -> None:
    from uuvsim_cosim.learn.training.curriculum import Curriculum, Stage
    from uuvsim_cosim.learn.training.train_curriculum import settings_of

    stages = (Stage("source", 64), Stage("transition_1", 64, settings={"epsilon": 0.3}))
    dqn = Curriculum("x", (stages[0], stages[0], stages[1]), "idqn", {"epsilon_end": 0.1})
    assert settings_of(dqn, 0) == {"epsilon_end": 0.1}
    assert settings_of(dqn, 1) == {"epsilon_end": 0.1, "epsilon": 0.1, "warm_up": 0}
    assert settings_of(dqn, 2)["epsilon"] == 0.3  # what a stage asks for comes last
    assert settings_of(Curriculum("x", stages[:1] * 2, "idqn"), 1)["epsilon"] == 0.05
    assert settings_of(Curriculum("x", stages[:1] * 2, "ippo"), 1) == {}
    sac = settings_of(Curriculum("x", stages[:1] * 2, "isac"), 1)
    assert sac == {"warm_up": 0, "critic_only": 500}


@pytest.mark.parametrize("name", TRANSFERS)
def test_networks_of_other_shapes_are_refused(name: str) -> None:
    with pytest.raises(InputInvalid, match="after a switch; expected"):
        made(name, 2, 0, hidden=8).go_on_from(taught(name, 1), 0)
