from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.envs.two import Advance
from uuvsim_cosim.envs.task.task import Channel
from uuvsim_cosim.envs.team import CosimParallelEnv
from uuvsim_cosim.envs.team_vector import CosimTeamVectorEnv
from uuvsim_cosim.errors import InputInvalid

N, SEED = 5, 40
COMING_AND_GOING: Any = {"late": (0.0, 0.6), "wall": 0.55, "leaves": {"rov_2": 2.1}}
Make = Callable[..., CosimTeamVectorEnv]


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[CosimTeamVectorEnv] = []

    def one(n: int = N, team: Any = None, **options: Any) -> CosimTeamVectorEnv:
        made.append(CosimTeamVectorEnv(Advance(2, **(team or {})), n, **options))
        return made[-1]

    yield one
    for env in made:
        env.close()


class Beside:
    """Parallel environments, one for each row, told as arrays."""

    def __init__(self, team: Any) -> None:
        self.envs = [CosimParallelEnv(Advance(2, **team)) for _ in range(N)]

    def reset(self, row: int, seed: int | None = None) -> Any:
        observation, _ = self.envs[row].reset(seed=seed)
        return self.arrays(row, observation)

    def step(self, row: int, actions: Any) -> Any:
        env = self.envs[row]
        given = {a: actions[j] for j, a in enumerate(env.possible_agents) if a in env.agents}
        observation, *rest, _ = env.step(given)
        return self.arrays(row, observation, *rest)

    def arrays(self, row: int, observation: Any, *rest: Any) -> Any:
        agents = self.envs[row].possible_agents
        seen = np.array([observation.get(a, np.zeros(4, np.float32)) for a in agents])
        present = np.array([a in self.envs[row].agents for a in agents])
        return seen, *(np.array([r.get(a, 0) for a in agents]) for r in rest), present


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("team", [{}, COMING_AND_GOING], ids=["all", "some"])
def test_row_i_is_the_parallel_environment_of_seed_s_plus_i(
    make: Make, mode: AutoresetMode, team: Any
) -> None:
    env, beside = make(team=team, autoreset_mode=mode), Beside(team)
    rng = np.random.default_rng(0)
    batch, _ = env.reset(seed=SEED)
    for i in range(N):
        seen, present = beside.reset(i, SEED + i)
        np.testing.assert_array_equal(batch[i], seen)
        np.testing.assert_array_equal(env.present[i], present)
    ends = 0
    for _ in range(25):
        over = ~env.present.any(axis=1)
        actions = rng.uniform(-1, 1, (N, 2, 1)).astype(np.float32)
        batch, reward, terminated, truncated, infos = env.step(actions)
        final = infos.get("final_obs", batch)
        again = np.zeros(N, bool)
        for i in range(N):
            if over[i]:  # only in NEXT_STEP
                seen, present = beside.reset(i)
                np.testing.assert_array_equal(batch[i], seen)
                assert not reward[i].any()
                assert not infos["acted"][i].any()
                continue
            state = env.state()[i]
            seen, r, t1, t2, present = beside.step(i, actions[i])
            again[i] = not present.any()
            last = final if again[i] else batch
            np.testing.assert_array_equal(last[i], seen)
            np.testing.assert_array_equal(reward[i], r)
            np.testing.assert_array_equal(terminated[i], t1.astype(bool))
            np.testing.assert_array_equal(truncated[i], t2.astype(bool))
            if again[i] and mode == AutoresetMode.SAME_STEP:
                last_state = beside.envs[i].state()
                np.testing.assert_array_equal(infos["final_state"][i], last_state)
                assert infos["_final_obs"][i]
                first, present = beside.reset(i)
                np.testing.assert_array_equal(batch[i], first)
            else:
                np.testing.assert_array_equal(state, beside.envs[i].state())
                np.testing.assert_array_equal(infos["present"][i], present)
        ends += again.sum()
        if mode == AutoresetMode.DISABLED and again.any():
            batch, _ = env.reset(options={"reset_mask": again})
            for i in np.flatnonzero(again):
                np.testing.assert_array_equal(batch[i], beside.reset(i)[0])
    assert ends >= 2 * N - 2
    for e in beside.envs:
        e.close()


def test_many_rows_have_the_bits_of_few(make: Make) -> None:
    few, many = make(2), make(19, threads=2)
    actions = np.random.default_rng(1).uniform(-1, 1, (12, 19, 2, 1))
    few.reset(seed=SEED)
    many.reset(seed=SEED)
    for a in actions:
        first = few.step(a[:2])
        second = many.step(a)
        for x, y in zip(first[:4], second[:4], strict=True):
            assert x.tobytes() == y[:2].tobytes()


def test_masters_have_the_bits_of_the_kernel(make: Make) -> None:
    kernel, master = make(2), make(2, backend="master", processes=0)
    kernel.reset(seed=SEED)
    master.reset(seed=SEED)
    for _ in range(5):
        a, b = (e.step(np.full((2, 2, 1), 0.4)) for e in (kernel, master))
        assert [x.tobytes() for x in a[:4]] == [x.tobytes() for x in b[:4]]


def test_the_shapes_are_environments_agents_widths(make: Make) -> None:
    env = make()
    observation, _ = env.reset(seed=1)
    observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
    assert observation.shape == (N, 2, 4)
    assert reward.shape == terminated.shape == truncated.shape == env.present.shape == (N, 2)
    assert env.state().shape == (N, 12)
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP


def test_actions_of_those_who_are_not_there_are_ignored(make: Make) -> None:
    given = []
    for absent in (np.nan, 1.0):
        env = make(team={"late": (0.0, 9.0)})
        env.reset(seed=1)
        actions = np.zeros((N, 2, 1))
        actions[:, 1] = absent
        observation, *_ = env.step(actions)
        given.append((observation.tobytes(), env.state().tobytes()))
        assert not observation[:, 1].any()
    assert given[0] == given[1]


def test_actions_are_not_changed_and_results_are_kept(make: Make) -> None:
    env = make(team={"late": (0.0, 0.6)})
    env.reset(seed=1)
    actions = np.full((N, 2, 1), 0.5)
    first = env.step(actions)
    copies = [x.copy() for x in first[:4]]
    for _ in range(12):
        env.step(actions)
    assert (actions == 0.5).all()
    assert all((x == y).all() for x, y in zip(first[:4], copies, strict=True))


class Mixed(Advance):
    def __init__(self) -> None:
        super().__init__()
        self.actions["rov_2"] = (
            Channel("rov_2.thruster.u", -1, 1),
            Channel("rov_2.hull.tau[2]", -1, 1),
        )


class Wide(Advance):
    def limits(self, agent: str) -> tuple[Any, Any]:
        edge = np.full(4, 10.0 if agent == "rov_1" else 20.0)
        return -edge, edge


def test_agents_with_other_spaces_are_refused_by_name() -> None:
    with pytest.raises(
        InputInvalid, match=r"actions of 'rov_2' have shape \(2,\), those of 'rov_1'"
    ):
        CosimTeamVectorEnv(Mixed(), 2)
    with pytest.raises(InputInvalid, match=r"limits of 'rov_2' differ"):
        CosimTeamVectorEnv(Wide(), 2)


@pytest.mark.parametrize("wrong", [np.zeros((N, 2)), np.full((N, 2, 1), np.nan), [["a"]]])
def test_wrong_actions_are_refused(make: Make, wrong: Any) -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match="expected"):
        env.step(wrong)


def test_a_step_before_a_reset_is_refused(make: Make) -> None:
    with pytest.raises(InputInvalid, match="expected reset"):
        make().step(np.zeros((N, 2, 1)))


def test_rows_that_have_ended_must_be_reset_when_autoreset_is_disabled(make: Make) -> None:
    env = make(autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=1)
    for _ in range(10):
        env.step(np.zeros((N, 2, 1)))
    with pytest.raises(InputInvalid, match="environments 0, 1, 2, 3, 4 have ended"):
        env.step(np.zeros((N, 2, 1)))


@pytest.mark.parametrize("seed", ["7", 1.5, -1, [1, 2], True])
def test_a_wrong_seed_is_refused(make: Make, seed: Any) -> None:
    with pytest.raises(InputInvalid, match="seed"):
        make().reset(seed=seed)


@pytest.mark.parametrize("n", [0, 1.5, True])
def test_a_wrong_number_of_environments_is_refused(n: Any) -> None:
    with pytest.raises(InputInvalid, match="num_envs"):
        CosimTeamVectorEnv(Advance(), n)


def test_a_wrong_autoreset_mode_is_refused() -> None:
    with pytest.raises(InputInvalid, match="autoreset_mode 'later'; expected one of 'NextStep'"):
        CosimTeamVectorEnv(Advance(), 1, autoreset_mode="later")


def test_closing_twice_does_nothing_and_a_step_after_it_is_refused(make: Make) -> None:
    env = make()
    env.close()
    env.close()
    with pytest.raises(InputInvalid, match="closed"):
        env.step(np.zeros((N, 2, 1)))
