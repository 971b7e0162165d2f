from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import pytest

from tests.envs.drift import LIMIT, Drift
from uuvsim_cosim import envs
from uuvsim_cosim.envs.registration import SHIPPED, register_shipped
from uuvsim_cosim.errors import InputInvalid

ID = "tests/Drift-v0"


@pytest.fixture(autouse=True)
def drift() -> Iterator[None]:
    envs.register(ID, "tests.envs.drift:Drift", reach=0.5)
    yield
    del gymnasium.registry[ID]


def test_an_id_makes_one_environment_with_options_of_its_task() -> None:
    env = gymnasium.make(ID, force=20.0, backend="kernel")
    assert isinstance(env.unwrapped, envs.CosimEnv)
    assert env.unwrapped.task.reach == 0.5  # type: ignore[attr-defined]
    assert env.unwrapped.task.actions[0].high == 20.0
    assert env.spec is not None
    assert env.spec.max_episode_steps == LIMIT
    env.close()


def test_an_id_makes_many_environments_as_one_object() -> None:
    env: Any = gymnasium.make_vec(ID, num_envs=3, threads=2, autoreset_mode="SameStep", reach=2.0)
    assert isinstance(env, envs.CosimVectorEnv)
    assert env.num_envs == 3
    assert env.task.reach == 2.0  # type: ignore[attr-defined]
    env.reset(seed=1)
    env.close()


def test_the_spec_makes_an_equal_environment_and_is_json() -> None:
    env = gymnasium.make(ID, force=20.0)
    assert env.spec is not None
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.task.actions[0].high == 20.0  # type: ignore[attr-defined]
    env.close()
    again.close()


def test_a_function_may_make_the_task() -> None:
    envs.register("tests/Made-v0", lambda depth=2.0: Drift(reach=depth))
    env = gymnasium.make("tests/Made-v0", depth=3.0)
    assert env.unwrapped.task.reach == 3.0  # type: ignore[attr-defined]
    env.close()
    del gymnasium.registry["tests/Made-v0"]


def test_every_shipped_id_has_a_vector_entry_point_and_no_second_time_limit() -> None:
    register_shipped()
    assert SHIPPED
    for id in SHIPPED:
        spec = gymnasium.spec(id)
        assert spec.vector_entry_point is not None
        assert spec.max_episode_steps is None


@pytest.mark.parametrize("name", ["tests.envs.drift", "no such:thing", 3 * ":"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(InputInvalid, match=r"expected 'package.module:name'"):
        envs.register("tests/Wrong-v0", name)


def test_a_module_that_is_missing_is_refused_when_made() -> None:
    envs.register("tests/Missing-v0", "tests.envs.drift:Drrift")
    with pytest.raises(InputInvalid, match=r"Drrift.*expected 'package.module:name'"):
        gymnasium.make("tests/Missing-v0")
    del gymnasium.registry["tests/Missing-v0"]


def test_options_that_the_task_does_not_have_are_refused() -> None:
    with pytest.raises(InputInvalid, match=r"rech.*expected an option of its own such as reach"):
        gymnasium.make(ID, rech=1.0)
    with pytest.raises(InputInvalid, match="expected horizon="):
        gymnasium.make_vec(ID, num_envs=2, max_episode_steps=5)
