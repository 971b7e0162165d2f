from __future__ import annotations

import pickle
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from pettingzoo.utils.conversions import parallel_to_aec

from tests.envs.two import Advance, vehicles
from uuvsim_cosim.envs import Task, TeamTask
from uuvsim_cosim.envs.conformance.suite import check
from uuvsim_cosim.envs.task.task import Channel
from uuvsim_cosim.envs.tasks.tracking_scenarios import target
from uuvsim_cosim.envs.team import CosimParallelEnv
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

with warnings.catch_warnings():  # of the imports inside
    warnings.simplefilter("ignore")
    from pettingzoo.test import api_test

Make = Callable[..., CosimParallelEnv]


@pytest.fixture
def make() -> Iterator[Make]:
    made: list[CosimParallelEnv] = []

    def one(*args: Any, backend: Any = "auto", **options: Any) -> CosimParallelEnv:
        made.append(CosimParallelEnv(Advance(*args, **options), backend=backend))
        return made[-1]

    yield one
    for env in made:
        env.close()


def full(env: CosimParallelEnv, u: float = 1.0) -> dict[str, Any]:
    return {a: np.full(1, u, np.float32) for a in env.agents}


def episode(env: CosimParallelEnv, seed: int | None = 3) -> list[Any]:
    given: list[Any] = [env.reset(seed=seed)]
    while env.agents:
        given.append((*env.step(full(env, 0.7)), list(env.agents), env.state()))
    return given


def bits(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: bits(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [bits(v) for v in value]
    return value.tobytes() if isinstance(value, np.ndarray) else value


@pytest.mark.parametrize("options", [{}, {"late": (0.0, 0.6), "wall": 0.6}], ids=["all", "some"])
def test_it_keeps_every_claim_of_the_conformance_suite(options: Any) -> None:
    report = check(lambda: CosimParallelEnv(Advance(2, **options)))
    assert not report.of("not applicable")


def test_target_tracking_as_a_team_keeps_every_claim() -> None:
    assert not check(lambda: CosimParallelEnv(target())).of("not applicable")


def test_its_aec_view_passes_pettingzoos_own_test(make: Make) -> None:
    api_test(parallel_to_aec(make(late=(0.0, 0.9))), num_cycles=30)


def test_a_team_that_shrinks_passes_pettingzoos_test_of_the_aec_view(make: Make) -> None:
    api_test(parallel_to_aec(make(wall=0.5)), num_cycles=30)


def test_the_kernel_and_the_masters_give_the_same_bits(make: Make) -> None:
    assert bits(episode(make(backend="kernel"))) == bits(episode(make(backend="master")))


@pytest.mark.parametrize("backend", ["kernel", "master"])
def test_an_action_of_three_tenths_is_always_three_communication_steps(
    make: Make, backend: Any
) -> None:
    env = make(backend=backend, horizon="30")
    env.reset(seed=1)
    ticks = []
    for _ in range(100):
        env.step(full(env))
        plant: Any = env._simulation.episodes.plant  # type: ignore[union-attr]
        ticks.append(plant._batch.tick[0] if backend == "kernel" else plant._rows[0].master.tick)
    assert ticks == list(range(3, 303, 3))


def test_each_agent_moves_its_own_vehicle(make: Make) -> None:
    env = make()
    first, _ = env.reset(seed=1)
    for _ in range(5):
        seen, *_ = env.step({"rov_1": np.ones(1, np.float32), "rov_2": -np.ones(1, np.float32)})
    assert seen["rov_1"][0] > first["rov_1"][0]
    assert seen["rov_2"][0] < first["rov_2"][0]


def test_an_agent_that_ends_is_told_once_and_leaves(make: Make) -> None:
    env = make(wall=0.8)
    start = {"rov_1.hull.eta_0": [0.79, 0, 1, 0, 0, 0], "rov_2.hull.eta_0": [-2.0, 1, 1, 0, 0, 0]}
    env.reset(seed=1, options={"start": start})
    while "rov_1" in env.agents:
        observation, _, terminated, truncated, _ = env.step(full(env))
    assert terminated == {"rov_1": True, "rov_2": False}
    assert not any(truncated.values())
    assert env.agents == ["rov_2"]
    assert observation["rov_1"][0] > 0.8
    observation, *_ = env.step(full(env))
    assert list(observation) == ["rov_2"]


def test_an_agent_that_comes_later_is_seen_when_it_comes_and_acts_next(make: Make) -> None:
    env = make(late=(0.0, 0.6))
    observation, _ = env.reset(seed=1)
    assert (list(observation), env.agents) == (["rov_1"], ["rov_1"])
    observation, *_ = env.step(full(env))
    assert list(observation) == ["rov_1"]
    observation, reward, *_ = env.step(full(env))
    assert (list(observation), env.agents) == (["rov_1", "rov_2"], ["rov_1", "rov_2"])
    assert reward["rov_2"] == 0.0


def test_an_agent_that_leaves_is_truncated_and_does_not_come_back(make: Make) -> None:
    env = make(leaves={"rov_2": 0.9})
    given = episode(env)
    _, _, terminated, truncated, _, agents, _ = given[3]
    assert (terminated["rov_2"], truncated["rov_2"], agents) == (False, True, ["rov_1"])
    assert all(list(g[0]) == ["rov_1"] for g in given[4:])


def test_the_horizon_truncates_all_that_are_there(make: Make) -> None:
    *_, (_, _, terminated, truncated, _, agents, _) = episode(make())
    assert (terminated, truncated) == (
        {"rov_1": False, "rov_2": False},
        {"rov_1": True, "rov_2": True},
    )
    assert agents == []


def test_the_next_episode_has_all_agents_again(make: Make) -> None:
    env = make(leaves={"rov_2": 0.9})
    episode(env)
    env.reset()
    assert env.agents == ["rov_1", "rov_2"]


def test_the_state_is_the_central_one(make: Make) -> None:
    env = make()
    observation, _ = env.reset(seed=1)
    assert env.state_space.contains(env.state())
    assert [env.state()[0], env.state()[6]] == [observation["rov_1"][0], observation["rov_2"][0]]


def test_a_pickled_environment_goes_on_with_the_next_episode(make: Make) -> None:
    env = make()
    env.reset(seed=3)
    copied = pickle.loads(pickle.dumps(env))
    assert bits(episode(copied, None)) == bits(episode(env, None))
    copied.close()


def test_metadata_say_what_it_is(make: Make) -> None:
    metadata = make().metadata
    assert metadata["name"] == "Advance"
    assert metadata["is_parallelizable"]
    assert metadata["render_fps"] == 1 / 0.3


def test_a_picture_is_drawn_of_every_hull() -> None:
    env = CosimParallelEnv(Advance(), render_mode="rgb_array")
    env.reset(seed=1)
    pixels = env.render()
    assert pixels.dtype == np.uint8
    assert pixels.shape[2] == 3
    env.close()


# ---- what is refused ----------------------------------------------------------------------


def test_more_agents_than_vehicles_are_refused_with_the_names_there_are() -> None:
    with pytest.raises(InputInvalid, match=r"agents: 3, of which 'rov_3' cannot act in 'vehicles'; "
                       r"expected at most 2(.|\n)*'rov_3'(.|\n)*rov_1|rov_2"):  # fmt: skip
        CosimParallelEnv(Advance(2, agents=3))


def test_a_system_without_the_vehicle_is_refused() -> None:
    other = System("other", "0.1").add("boat", vehicles(1).nested("rov_1"))
    with pytest.raises(InputInvalid, match=r"'rov_1.thruster.u'.*boat"):
        CosimParallelEnv(Advance(1, system=other))


class Shared(Advance):
    def __init__(self) -> None:
        super().__init__()
        self.actions["rov_2"] = (Channel("rov_1.thruster.u", -1, 1),)


def test_two_agents_on_one_input_are_refused() -> None:
    with pytest.raises(
        InputInvalid, match=r"'rov_2': acts on 'rov_1.thruster.u\[1\]', as 'rov_1' does"
    ):
        CosimParallelEnv(Shared())


def test_an_unknown_agent_is_refused_with_near_names(make: Make) -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match=r"no agent 'rov1'; expected one such as rov_1"):
        env.step({**full(env), "rov1": np.zeros(1)})
    with pytest.raises(InputInvalid, match="no agent 'w'; expected one of rov_1, rov_2"):
        env.action_space("w")


def test_a_missing_action_is_refused_by_the_agents_name(make: Make) -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(
        InputInvalid, match="no action for 'rov_2'; expected one for each of rov_1, rov_2"
    ):
        env.step({"rov_1": np.zeros(1)})


def test_an_action_for_an_agent_that_is_not_there_is_refused(make: Make) -> None:
    env = make(late=(0.0, 0.9))
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match="'rov_2', which has ended or is not present yet"):
        env.step({"rov_1": np.zeros(1), "rov_2": np.zeros(1)})


@pytest.mark.parametrize("wrong", [np.zeros(2), np.array([np.nan]), "left", None])
def test_a_wrong_action_is_refused_by_the_agents_name(make: Make, wrong: Any) -> None:
    env = make()
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match=r"agent 'rov_2'.*expected .*\[-1, 1\]"):
        env.step({"rov_1": np.zeros(1), "rov_2": wrong})


def test_a_step_without_a_reset_or_after_the_end_is_refused(make: Make) -> None:
    env = make()
    with pytest.raises(InputInvalid, match=r"expected reset\(\) before step\(\)"):
        env.step({})
    episode(env)
    with pytest.raises(InputInvalid, match=r"expected reset\(\) before step\(\)"):
        env.step({})


def test_a_start_without_anybody_is_refused(make: Make) -> None:
    with pytest.raises(InputInvalid, match="no agent at the start of an episode"):
        make(late=(1.0, 1.0)).reset(seed=1)


def test_an_action_step_that_is_no_multiple_is_refused_with_both_numbers() -> None:
    with pytest.raises(InputInvalid, match=r"0\.25 s, where a communication step takes 0\.1 s"):
        CosimParallelEnv(Advance(action_step="0.25"))


def test_a_task_of_one_agent_is_refused() -> None:
    class One(Task):
        def reward(self, m: Any) -> Any:
            return m.time

    task = One(
        vehicles(1),
        actions=[Channel("rov_1.thruster.u", -1, 1)],
        observations=[Channel("rov_1.hull.eta")],
        action_step="0.1",
        horizon="1",
    )
    with pytest.raises(InputInvalid, match="expected a TeamTask"):
        CosimParallelEnv(task)  # type: ignore[arg-type]


class Silent(Advance):
    def reward(self, m: Any) -> dict[str, Any]:
        return {"rov_1": m.time}


def test_a_task_that_forgets_an_agent_is_refused_by_the_agents_name() -> None:
    env = CosimParallelEnv(Silent())
    env.reset(seed=1)
    with pytest.raises(InputInvalid, match=r"reward\(\) has nothing for 'rov_2'"):
        env.step(full(env))
    env.close()


class Twisted(Advance):
    def observe(self, m: Any) -> dict[str, Any]:
        return {a: v[:, :2] for a, v in super().observe(m).items()}


def test_an_observation_of_another_width_than_its_limits_is_refused() -> None:
    env = CosimParallelEnv(Twisted())
    with pytest.raises(InputInvalid, match=r"'rov_1' of shape \(1, 2\); expected \(1, 4\)"):
        env.reset(seed=1)
    env.close()


class Forgetful(Advance):
    def __init__(self, agents: list[str], actions: dict[str, Any]) -> None:
        TeamTask.__init__(
            self, vehicles(1), agents=agents, actions=actions, action_step="0.1", horizon="1"
        )


def test_a_task_without_actions_for_an_agent_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"actions for a; expected .* agents a, b"):
        Forgetful(["a", "b"], {"a": ()})
    with pytest.raises(InputInvalid, match="each named once"):
        Forgetful(["a", "a"], {"a": ()})
