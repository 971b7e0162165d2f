"""Stacked networks: their gradients, and what of them leaves."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import layer_norm

from uuvsim_cosim.envs.task.task import Symmetry
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.masac import Masac, MasacSettings
from uuvsim_cosim.learn.algorithms.off_policy_learner import MasacLearner, OffPolicySettings
from uuvsim_cosim.learn.algorithms.replay_buffer import Replay, Transitions
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP
from uuvsim_cosim.learn.algorithms.transfer import transfer

RNG = np.random.default_rng(5)


def lived(n: int, agents: int, width: int) -> Transitions:
    o, a, r, after = (
        RNG.normal(size=s).astype(np.float32)
        for s in ((n, agents, width), (n, agents, 2), (n, agents), (n, agents, width))
    )
    return Transitions(o, a, r, after, np.zeros((n, agents), np.float32))


@pytest.mark.parametrize("normalised", [False, True])
def test_gradients_are_those_of_autograd(normalised: bool) -> None:
    random = torch.Generator().manual_seed(0)
    net = StackedMLP(3, [5, 16, 16, 2], random, normalised=normalised).double()
    x = torch.randn(3, 7, 5, dtype=torch.double, generator=random).requires_grad_()

    def by_autograd(h: Tensor) -> Tensor:
        for i, (w, b) in enumerate(zip(net.weights, net.biases, strict=True)):
            h = torch.baddbmm(b, h, w)
            if i < 2:
                h = torch.relu(layer_norm(h, (16,)) if normalised else h)
        return h

    weight = torch.randn(3, 7, 2, dtype=torch.double, generator=random)
    every = [x, *net.parameters()]
    ours = torch.autograd.grad((net(x) * weight).sum(), every)
    theirs = torch.autograd.grad((by_autograd(x) * weight).sum(), every)
    for a, b in zip(ours, theirs, strict=True):
        assert torch.allclose(a, b, rtol=1e-12, atol=1e-14)


def test_an_input_that_needs_no_gradient_gets_none_and_weights_that_need_none_neither() -> None:
    net = StackedMLP(1, [2, 4, 1], torch.Generator().manual_seed(0)).requires_grad_(False)
    x = torch.ones(1, 3, 2, requires_grad=True)
    net(x).sum().backward()
    assert x.grad is not None
    assert all(p.grad is None for p in net.parameters())


def test_what_leaves_follows_the_actor_slowly_and_goes_on_in_the_next_task() -> None:
    slow = Masac(2, 5, 2, MasacSettings(hidden=16, average=0.1), 0)
    at_once = Masac(2, 5, 2, MasacSettings(hidden=16), 0)
    began = slow.tensors(0)["0.weight"]
    drawn = lived(32, 2, 5)
    for masac in (slow, at_once):
        masac.update(drawn)
    learned = at_once.tensors(0)["0.weight"]
    assert np.abs(learned - began).max() > 1e-5
    assert slow.tensors(0)["0.weight"] == pytest.approx(0.9 * began + 0.1 * learned, abs=1e-6)
    now = drawn.observation[:4]
    last = slow.act(now, explore=False)
    given = transfer(slow, 2, np.ones(5, bool))
    assert np.array_equal(given.act(now, explore=False), last)


def test_draws_are_as_they_were_or_in_one_of_the_images() -> None:
    image = Symmetry("image", np.array([1.0, -1.0, 1.0]), np.array([1.0, -1.0]))
    replay = Replay(1, 2, 3, 2)
    replay.add(lived(1, 2, 3))
    plain = replay.draw(1, np.random.default_rng(0))
    drawn = replay.draw(200, np.random.default_rng(0), [image])
    turned = drawn.observation[:, 0, 1] != plain.observation[0, 0, 1]
    assert 60 < turned.sum() < 140
    signs = np.where(turned[:, None, None], -1.0, 1.0)
    for name in ("observation", "after", "action"):
        values, was = getattr(drawn, name), getattr(plain, name)
        assert np.array_equal(values[..., 1:2], was[..., 1:2] * signs)
        assert np.array_equal(values[..., :1], np.repeat(was[..., :1], 200, axis=0))
    assert np.array_equal(drawn.reward, np.repeat(plain.reward, 200, axis=0))


def test_mirror_without_a_symmetry_is_refused() -> None:
    with pytest.raises(InputInvalid, match="no symmetry"):
        MasacLearner(1, 3, 2, schedule=OffPolicySettings(mirror=True))
