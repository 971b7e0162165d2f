from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tests.envs.drift import LIMIT, Drift
from uuvsim_cosim.envs.episodes.episodes import AGENT, Episodes
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.errors import InputInvalid


@pytest.fixture
def simulation() -> Iterator[TaskSimulation]:
    made = TaskSimulation(Drift(), 4)
    yield made
    made.episodes.close()


@pytest.fixture
def episodes(simulation: TaskSimulation) -> Episodes:
    simulation.episodes.reset(seeds=[1, 2, 3, 4])
    return simulation.episodes


def test_after_a_reset_the_moment_before_is_the_moment_itself(episodes: Episodes) -> None:
    m = episodes.moment
    assert m.before is m
    assert m.time.tolist() == [0.0] * 4
    np.testing.assert_array_equal(m.action[AGENT], np.zeros((4, 3)))
    np.testing.assert_allclose(m.start["hull.eta_0"], m["hull.eta"], atol=1e-12)


def test_a_moment_knows_the_one_before_and_no_older_one(
    simulation: TaskSimulation, episodes: Episodes
) -> None:
    first = episodes.moment
    second = simulation.act(np.ones((4, 3)))
    third = simulation.act(np.full((4, 3), 2.0))
    assert third.before is second
    assert second.before is second
    assert first.before is first
    assert third.step.tolist() == [2] * 4
    np.testing.assert_allclose(third.time, 0.4)
    np.testing.assert_array_equal(third.action[AGENT], np.ones((4, 3)))


def test_a_partial_reset_leaves_the_others_as_they_were(
    simulation: TaskSimulation, episodes: Episodes
) -> None:
    old = simulation.act(np.ones((4, 3)))
    mask = np.array([False, True, False, True])
    new = episodes.reset(mask)
    np.testing.assert_array_equal(new["hull.eta"][~mask], old["hull.eta"][~mask])
    assert new.step.tolist() == [1, 0, 1, 0]
    np.testing.assert_array_equal(new.before["hull.eta"][mask], new["hull.eta"][mask])
    np.testing.assert_array_equal(new.before["hull.eta"][~mask], old.before["hull.eta"][~mask])
    np.testing.assert_array_equal(new.before.step, [0, 0, 0, 0])
    np.testing.assert_array_equal(new.action[AGENT][mask], np.zeros((2, 3)))
    assert episodes.episodes.tolist() == [0, 1, 0, 1]


def test_nobody_can_change_a_moment(episodes: Episodes) -> None:
    with pytest.raises(ValueError, match="read-only"):
        episodes.moment["hull.eta"][0, 0] = 1.0


def test_start_values_are_those_that_the_task_draws(episodes: Episodes) -> None:
    episodes.reset()
    drawn = Drift().start(Draws([1, 2, 3, 4], [1, 1, 1, 1]))["hull.eta_0"]
    np.testing.assert_array_equal(episodes.moment.start["hull.eta_0"], drawn)


def test_draws_of_an_environment_alone_are_those_among_many() -> None:
    many = Draws([7] * 200, np.arange(200))
    for episode in (0, 1, 5, 63, 64, 65, 130, 3):
        one = Draws([7], [episode])
        np.testing.assert_array_equal(one.seeds(), many.seeds()[episode : episode + 1])
        for shape in ((), (3,), (2, 2), (0,)):
            got = one.uniform("a", -1, 2, shape)
            np.testing.assert_array_equal(got[0], many.uniform("a", -1, 2, shape)[episode])


def test_an_episode_is_over_after_the_horizon(
    simulation: TaskSimulation, episodes: Episodes
) -> None:
    for k in range(LIMIT):
        assert not episodes.over.any(), k
        simulation.act(np.zeros((4, 3)))
    assert episodes.over.all()


def test_a_moment_before_the_first_reset_is_refused(simulation: TaskSimulation) -> None:
    with pytest.raises(InputInvalid, match=r"expected reset\(\) first"):
        _ = simulation.episodes.moment


@pytest.mark.parametrize("n", [1, 3, 20])
def test_draws_that_are_made_together_have_the_bits_of_each_alone(n: int) -> None:
    seeds, episodes = np.arange(n, dtype=np.uint64) * 2**40 + 7, np.arange(n) % 4
    asked: dict[tuple[str, int], int] = {}
    for _ in range(3):  # the second and third time from one call for all names
        made = []
        for draws in (Draws(seeds, episodes), Draws(seeds, episodes, asked=asked)):
            made.append(
                [
                    draws.seeds(),
                    draws.uniform("a"),
                    draws.uniform("b", 0, 2, (3,)),
                    draws.normal("c", (6,)),
                    draws.uniform("a", shape=(2,)),
                    draws.uniform("none", shape=(0,)),
                ]
            )
        for alone, together in zip(*made, strict=True):
            assert (alone.dtype, alone.shape) == (together.dtype, together.shape)
            assert alone.tobytes() == together.tobytes()
    assert len(asked) == 5
    assert draws._drawn.keys() == asked.keys()
