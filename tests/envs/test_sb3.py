"""Stable-Baselines3's VecEnv over CosimVectorEnv: same numbers, its own conventions at the end."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from uuvsim_cosim.envs.sb3 import Sb3VecEnv
from uuvsim_cosim.envs.tasks import StationKeeping, TargetTracking
from uuvsim_cosim.envs.vector import CosimVectorEnv
from uuvsim_cosim.errors import InputInvalid


def test_it_gives_the_numbers_of_the_vector_environment_and_the_last_observation() -> None:
    task = StationKeeping(horizon=1)
    ours = Sb3VecEnv(task, 3)
    vector = CosimVectorEnv(task, 3, autoreset_mode=AutoresetMode.SAME_STEP)
    ours.seed(5)
    expected, _ = vector.reset(seed=5)
    assert np.array_equal(ours.reset(), expected)
    rng = np.random.default_rng(0)
    for k in range(25):
        actions = rng.uniform(-1, 1, (3, 6)).astype(np.float32)
        seen, rewards, ended, infos = ours.step(actions)
        a, b, terminated, truncated, told = vector.step(actions)
        assert np.array_equal(seen, a)
        assert np.array_equal(rewards, b.astype(np.float32))
        assert np.array_equal(ended, terminated | truncated)
        assert ended.all() == ((k + 1) % 10 == 0)
        for i in np.flatnonzero(ended):
            assert np.array_equal(infos[i]["terminal_observation"], told["final_obs"][i])
            assert infos[i]["TimeLimit.truncated"] is True
            assert infos[i]["position_error"] == told["final_info"]["position_error"][i]
    ours.close()
    vector.close()


def test_who_strays_is_terminated_and_not_truncated() -> None:
    env = Sb3VecEnv(StationKeeping(region=1e-6), 1)
    env.reset()
    _, _, ended, infos = env.step(np.zeros((1, 6)))
    assert ended[0]
    assert infos[0]["TimeLimit.truncated"] is False
    env.close()


def test_a_team_is_acted_on_by_one_central_agent() -> None:
    env = Sb3VecEnv(TargetTracking(2, 0), 2)
    assert env.action_space.shape == (4,)
    assert env.env_is_wrapped(object) == [False, False]  # type: ignore[arg-type]
    assert env.get_attr("num_envs", [0]) == [2]
    env.close()


def test_what_single_environments_cannot_do_is_refused() -> None:
    env = Sb3VecEnv(StationKeeping(), 2)
    with pytest.raises(InputInvalid, match="region: environments of one kernel share it"):
        env.set_attr("region", 3.0)
    with pytest.raises(InputInvalid, match="reset: cannot be called of single environments"):
        env.env_method("reset")
    env.close()
    with pytest.raises(InputInvalid, match="autoreset_mode: is SAME_STEP here"):
        Sb3VecEnv(StationKeeping(), 2, autoreset_mode="Disabled")
