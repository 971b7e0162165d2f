from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.envs.two import Advance
from uuvsim_cosim.envs.conformance.suite import check
from uuvsim_cosim.envs.single import CosimEnv
from uuvsim_cosim.envs.solo import Solo
from uuvsim_cosim.envs.team import CosimParallelEnv
from uuvsim_cosim.envs.vector import CosimVectorEnv


@pytest.mark.parametrize("n", [1, 2])
def test_a_team_as_one_agent_keeps_every_claim(n: int) -> None:
    task = Solo(Advance(n, wall=0.6))
    report = check(lambda: CosimEnv(task), vector=lambda m: CosimVectorEnv(task, m))
    assert not report.of("not applicable")


def test_a_team_of_one_is_its_only_agent() -> None:
    solo, team = CosimEnv(Solo(Advance(1))), CosimParallelEnv(Advance(1))
    assert solo.observation_space == team.observation_space("rov_1")
    assert solo.action_space == team.action_space("rov_1")
    a, _ = solo.reset(seed=5)
    b, _ = team.reset(seed=5)
    np.testing.assert_array_equal(a, b["rov_1"])
    for _ in range(10):
        action = np.full(1, 0.3, np.float32)
        one, r1, t1, u1, _ = solo.step(action)
        all_, r2, t2, u2, _ = team.step({"rov_1": action})
        np.testing.assert_array_equal(one, all_["rov_1"])
        assert (r1, t1, u1) == (r2["rov_1"], t2["rov_1"], u2["rov_1"])
    solo.close()
    team.close()


def test_two_agents_are_one_beside_the_other_with_a_flag_each() -> None:
    solo, team = CosimEnv(Solo(Advance(2, late=(0.0, 0.6)))), CosimParallelEnv(Advance(2))
    seen, _ = solo.reset(seed=5)
    both, _ = team.reset(seed=5)
    np.testing.assert_array_equal(seen, [*both["rov_1"], 0, 0, 0, 0, 1, 0])
    actions = np.array([0.5, -0.5], np.float32)
    for _ in range(2):
        seen, reward, *_ = solo.step(actions)
        both, each, *_ = team.step({"rov_1": actions[:1], "rov_2": actions[1:]})
    np.testing.assert_array_equal(seen, [*both["rov_1"], *both["rov_2"], 1, 1])
    assert reward == each["rov_1"] + each["rov_2"]
    solo.close()
    team.close()


def test_the_episode_is_terminated_as_soon_as_one_agent_is() -> None:
    env = CosimEnv(Solo(Advance(2, wall=0.8)))
    start: Any = {
        "rov_1.hull.eta_0": [0.79, 0, 1, 0, 0, 0],
        "rov_2.hull.eta_0": [-2.0, 1, 1, 0, 0, 0],
    }
    env.reset(seed=1, options={"start": start})
    terminated = truncated = False
    while not terminated and not truncated:
        _, _, terminated, truncated, _ = env.step(np.ones(2, np.float32))
    assert terminated
    env.close()
