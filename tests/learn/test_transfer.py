"""At the switch from one task to the next, actions are exactly unchanged."""

import numpy as np
import pytest
import torch

from uuvsim_cosim.learn.masac import Masac, MasacSettings
from uuvsim_cosim.learn.transfer import transfer


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


def test_columns_that_move_keep_their_weights() -> None:
    last = Masac(1, 3, 1, MasacSettings(hidden=8), 0)
    given = transfer(last, 1, np.ones(3, bool), columns=[0, 4, 2], observed=6)
    seen = np.random.default_rng(0).normal(size=(20, 1, 6)).astype(np.float32)
    expected = last.act(seen[:, :, [0, 4, 2]], explore=False)
    assert np.allclose(given.act(seen, explore=False), expected, atol=1e-7)
