"""The ring of transitions keeps the last ones, all of them, and draws each as often."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.envs.task.task import Symmetry
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.replay_buffer import Replay, Transitions, seen_by


def numbered(first: int, n: int) -> Transitions:
    """Transitions `first`, `first` + 1, … of two agents; each column says its number."""
    k = np.arange(first, first + n, dtype=np.float32)
    agents = np.stack([k, k + 0.5], 1)
    return Transitions(
        np.stack([agents, -agents], 2), agents[:, :, None] / 1000, 10 * agents,
        np.stack([agents + 1, -agents - 1], 2), (agents % 2 < 1).astype(np.float32),
    )  # fmt: skip


def held(ring: Replay) -> list[float]:
    """The numbers of what a ring keeps; refuses rows whose columns are of different ones."""
    kept = ring.state()
    number = kept["observation"][:, 0, 0]
    for name, column in vars(numbered(0, 0)).items():
        assert kept[name].shape[1:] == column.shape[1:]
    for row, k in enumerate(number):
        (one,) = [numbered(int(k), 1)]
        for name, column in vars(one).items():
            assert np.array_equal(kept[name][row], column[0]), name
    return sorted(number)


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 12), st.lists(st.integers(0, 12), max_size=12))
def test_a_ring_keeps_the_last_ones_whatever_comes_at_once(size: int, lots: list[int]) -> None:
    ring, total = Replay(size, 2, 2, 1), 0
    for n in (min(n, size) for n in lots):
        ring.add(numbered(total, n))
        total += n
        assert ring.count == min(total, size)
        assert held(ring) == list(range(max(total - size, 0), total))


def test_a_ring_drawn_from_gives_only_what_it_keeps_each_as_often() -> None:
    ring = Replay(8, 2, 2, 1)
    for first, n, kept in ((0, 3, range(3)), (3, 3, range(6)), (6, 5, range(3, 11))):
        ring.add(numbered(first, n))
        drawn = ring.draw(4000, np.random.default_rng(first))
        number = drawn.observation[:, 0, 0]
        counts = np.array([(number == k).sum() for k in kept])
        assert counts.sum() == 4000
        assert np.all(np.abs(counts - 4000 / len(kept)) < 5 * np.sqrt(4000 / len(kept)))
        assert np.array_equal(drawn.reward[:, 1], 10 * (number + 0.5))
        assert np.array_equal(drawn.after[:, 0, 0], number + 1)
        assert np.array_equal(drawn.action[:, 0, 0], (number / 1000).astype(np.float32))


def test_a_ring_that_is_taken_up_again_overwrites_the_oldest() -> None:
    ring = Replay(5, 2, 2, 1)
    ring.add(numbered(0, 4))
    ring.add(numbered(4, 3))  # the next place is in the middle
    again = Replay(5, 2, 2, 1)
    again.set_state(ring.state())
    for one in (ring, again):
        one.add(numbered(7, 2))
        assert held(one) == [4, 5, 6, 7, 8]
    drawn = [r.draw(20, np.random.default_rng(1)).reward for r in (ring, again)]
    assert np.array_equal(*drawn)


def test_more_than_fit_at_once_are_refused() -> None:
    with pytest.raises(InputInvalid, match="buffer of 5: 6 at once; expected at least 6"):
        Replay(5, 2, 2, 1).add(numbered(0, 6))


def test_a_symmetry_changes_observations_and_actions_of_half_and_no_reward() -> None:
    turned = Symmetry("mirror", np.array([1.0, -1.0]), np.array([-1.0]))
    given_ = numbered(1, 2000)
    seen = seen_by(given_, [turned], np.random.default_rng(0))
    flipped = seen.action[:, 0, 0] < 0
    assert 850 < flipped.sum() < 1150
    sign = np.where(flipped, -1.0, 1.0)[:, None]
    assert np.array_equal(seen.action[:, :, 0], given_.action[:, :, 0] * sign)
    for name in ("observation", "after"):
        now, was = getattr(seen, name), getattr(given_, name)
        assert np.array_equal(now[:, :, 0], was[:, :, 0])
        assert np.array_equal(now[:, :, 1], was[:, :, 1] * sign)
    assert np.array_equal(seen.reward, given_.reward)
    assert np.array_equal(seen.terminated, given_.terminated)
