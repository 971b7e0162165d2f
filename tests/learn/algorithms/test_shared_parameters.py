"""Options of MASAC: shared parameters, rewards taken off their mean, sums over several steps."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.learn.algorithms.masac import Masac, MasacSettings
from uuvsim_cosim.learn.algorithms.replay_buffer import NStep, Transitions
from uuvsim_cosim.learn.algorithms.transfer import transfer

SHARED = MasacSettings(hidden=32, shared=True)


def transitions(random: np.random.Generator, n: int, N: int, d: int = 7) -> Transitions:
    shapes = ((n, N, d), (n, N, 2), (n, N), (n, N, d))
    o, a, r, after = (random.normal(size=s).astype(np.float32) for s in shapes)
    return Transitions(o, a, r, after, np.zeros((n, N), np.float32))


@pytest.mark.parametrize("central", [True, False])
def test_agents_that_share_parameters_are_interchangeable(central: bool) -> None:
    masac = Masac(3, 7, 2, MasacSettings(hidden=32, shared=True, central=central), 0)
    random = torch.Generator().manual_seed(0)
    o, a = torch.randn(3, 5, 7, generator=random), torch.randn(3, 5, 2, generator=random)
    order = [1, 0, 2]
    there = masac._q(masac.critic, masac._seen(o, a))
    turned = masac._q(masac.critic, masac._seen(o[order], a[order]))
    assert torch.allclose(turned[[1, 0]], there[[0, 1]], atol=1e-6)
    acts = masac.act(o.transpose(0, 1).numpy(), explore=False)
    again = masac.act(o[order].transpose(0, 1).numpy(), explore=False)
    assert np.allclose(again[:, 0], acts[:, 1], atol=1e-6)


def test_a_critic_sees_its_own_agent_first() -> None:
    masac = Masac(2, 3, 1, MasacSettings(hidden=8, shared=True), 0)
    o, a = torch.arange(6.0).view(2, 1, 3), torch.tensor([[[10.0]], [[20.0]]])
    seen = masac._seen(o, a)
    assert seen[0, 0].tolist() == [0, 1, 2, 3, 4, 5, 10, 20]
    assert seen[1, 0].tolist() == [3, 4, 5, 0, 1, 2, 20, 10]
    own = masac._seen(o, a, -a)
    assert own[1, 0].tolist() == [3, 4, 5, 0, 1, 2, -20, 10]


@pytest.mark.parametrize(("old", "new"), [(1, 2), (2, 3), (3, 2), (2, 1)])
def test_shared_parameters_act_exactly_as_before_at_a_switch(old: int, new: int) -> None:
    last = Masac(old, 7, 2, SHARED, 0)
    given = transfer(last, new, np.arange(7) < 4, seed=1)
    seen = np.random.default_rng(0).normal(size=(20, new, 7)).astype(np.float32)
    asleep = np.where(np.arange(7) < 4, seen, 0).astype(np.float32)
    for i in range(new):
        before = np.repeat(asleep[:, i : i + 1], old, axis=1)
        expected = last.act(before, explore=False)[:, 0]
        assert np.allclose(given.act(seen, explore=False)[:, i], expected, atol=1e-6)


def test_what_shared_parameters_learn_does_not_depend_on_who_is_called_the_first() -> None:
    drawn = transitions(np.random.default_rng(3), 16, 2)
    swapped = Transitions(*(x[:, ::-1].copy() for x in vars(drawn).values()))
    losses = []
    for one in (drawn, swapped):
        masac = Masac(2, 7, 2, MasacSettings(hidden=32, shared=True, gamma=0.0), 0)
        losses.append(masac.update(one, critic_only=True)["critic_loss"])
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)


@pytest.mark.parametrize("ended", [0.0, 1.0])
def test_a_mean_reward_taken_off_only_shifts_values(ended: float) -> None:
    """Q - c / (1 - gamma) solves the equation with c off, if Q solves that with r."""
    masac = Masac(1, 3, 1, MasacSettings(hidden=8, gamma=0.9), 0)
    masac.centre[0] = 2.0
    r, v = 1.5, 7.0
    q = r + 0.9 * (1 - ended) * v
    shifted = r + 0.9 * (1 - ended) * (v - 2.0 / 0.1)
    off = float(masac._offset(torch.full((1, 1), ended))[0, 0])
    assert shifted - off == pytest.approx(q - 2.0 / 0.1, rel=1e-5)


def test_the_mean_that_is_taken_off_follows_the_error() -> None:
    masac = Masac(2, 7, 2, MasacSettings(hidden=16, centre=0.05), 0)
    drawn = transitions(np.random.default_rng(0), 32, 2)
    drawn.reward[:] = 10.0
    for _ in range(20):
        masac.update(drawn)
    assert masac.centre.min() > 1.0
    again = Masac(2, 7, 2, MasacSettings(hidden=16, centre=0.05), 1)
    again.set_state(masac.state())
    assert torch.equal(again.centre, masac.centre)


def stepped(rewards: list[float], ends: set[int], count: int, gamma: float) -> list[Transitions]:
    several, given = NStep(count, gamma), []
    for k, r in enumerate(rewards):
        o = np.full((1, 1, 1), k, np.float32)
        lived = Transitions(
            o, o, np.full((1, 1), r, np.float32), o + 1, np.zeros((1, 1), np.float32)
        )
        made = several(lived, np.array([k in ends]))
        given += [made] if made is not None else []
    return given


@settings(deadline=None, max_examples=30)
@given(
    st.lists(st.floats(-5, 5), min_size=6, max_size=12),
    st.sets(st.integers(0, 11)),
    st.integers(1, 4),
)
def test_a_sum_of_rewards_stops_where_an_episode_ends(
    rewards: list[float], ends: set[int], count: int
) -> None:
    for k, made in enumerate(stepped(rewards, ends, count, 0.9)):
        last = next((j for j in range(k, k + count) if j in ends), k + count - 1)
        K = last - k + 1
        expected = sum(0.9**j * rewards[k + j] for j in range(K))
        assert float(made.reward[0, 0]) == pytest.approx(expected, abs=1e-4)
        assert float(made.after[0, 0, 0]) == last + 1
        assert float(made.observation[0, 0, 0]) == k
        assert 0.9 * (1 - float(made.terminated[0, 0])) == pytest.approx(0.9**K, rel=1e-5)


def test_one_step_is_the_step_itself() -> None:
    random = np.random.default_rng(0)
    lived = transitions(random, 4, 2)
    made = NStep(1, 0.99)(lived, np.zeros(4, bool))
    assert made is not None
    for name, value in vars(lived).items():
        assert np.array_equal(getattr(made, name), value)
