"""An episode that cannot start ends its environment alone, on every backend alike."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.envs.drift import Drift
from tests.envs.two import Advance
from uuvsim_cosim.envs import Channel, CosimEnv, CosimTeamVectorEnv, CosimVectorEnv, FunctionTask
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

KINDS: dict[str, dict[str, Any]] = {
    "kernel": {"backend": "kernel"},
    "master": {"backend": "master", "processes": 0},
    "processes": {"backend": "master", "processes": 2},
}
EACH = pytest.mark.parametrize("kind", KINDS)
N = 6


class Wild(Drift):
    """Drift, whose hull starts too fast for any number in about a third of the episodes."""

    def __init__(self, share: float = 0.3, failure_reward: float = 0.0) -> None:
        super().__init__()
        self.share, self.failure_reward = share, failure_reward

    def start(self, draws: Draws) -> Mapping[str, Any]:
        nu = np.zeros((draws.n, 6))
        nu[:, 0] = np.where(wild(draws) < self.share, 1e200, 0.0)
        return {**super().start(draws), "hull.nu_0": nu}


def wild(draws: Draws) -> Any:
    return draws.uniform("wild")


def fails(seed: int, episode: int) -> bool:
    return bool(wild(Draws([seed], [episode]))[0] < 0.3)


@EACH
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_only_the_environment_whose_start_fails_ends(kind: str, mode: str) -> None:
    env = CosimVectorEnv(Wild(), N, autoreset_mode=mode, **KINDS[kind])
    env.reset(seed=0)
    episode = np.zeros(N, int)
    resets = np.zeros(N, bool)
    seen_failures = 0
    for _ in range(12):
        bad = np.array([fails(i, int(episode[i])) for i in range(N)])
        zero = np.zeros((N, 3))
        observations, rewards, terminated, truncated, infos = env.step(zero)
        expected = bad & ~resets
        if mode == "NextStep" and resets.any():
            episode += resets
            bad = np.array([fails(i, int(episode[i])) for i in range(N)])
            expected = bad & ~resets
        np.testing.assert_array_equal(terminated, expected)
        assert observations in env.observation_space
        assert (rewards[terminated] == 0).all()
        last = infos["final_info"] if mode == "SameStep" and expected.any() else infos
        for i in np.flatnonzero(terminated):
            seen_failures += 1
            assert last["failure"][i].startswith(f"environment {i}: component 'hull' failed")
        over = terminated | truncated
        if mode == "SameStep":
            episode += over
        else:
            resets = over
    assert seen_failures > 2
    env.close()


def test_every_backend_gives_the_same_bits_around_failed_starts() -> None:
    lived = []
    for options in KINDS.values():
        env = CosimVectorEnv(Wild(failure_reward=-5.0), N, **options)
        seen = [env.reset(seed=3)[0]]
        for k in range(12):
            observations, rewards, *ends, infos = env.step(np.full((N, 3), np.sin(k)))
            seen += [observations, rewards, *ends, infos.get("failure", np.zeros(0))]
        lived.append(seen)
        env.close()
    for other in lived[1:]:
        for a, b in zip(lived[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


@EACH
def test_a_reset_in_which_none_starts_raises_and_the_next_draws_anew(kind: str) -> None:
    env = CosimVectorEnv(Wild(share=2.0), 2, **KINDS[kind])
    with pytest.raises(ComponentFailed, match=r"in environment 0, and all others of 2 fail"):
        env.reset(seed=1)
    with pytest.raises(InputInvalid, match=r"expected reset\(\) first"):
        env.step(np.zeros((2, 3)))
    env.task.share = 0.0  # type: ignore[attr-defined]
    seen = env.reset()[0]
    fresh = CosimVectorEnv(Wild(share=0.0), 2, **KINDS[kind])
    fresh.reset(seed=1)
    np.testing.assert_array_equal(seen, fresh.reset()[0])
    env.close()
    fresh.close()


@pytest.mark.parametrize("backend", ["kernel", "master"])
def test_a_single_environment_raises_and_goes_on_with_the_next_episode(backend: Any) -> None:
    seed = next(s for s in range(99) if fails(s, 0) and not fails(s, 1))
    env = CosimEnv(Wild(), backend=backend)
    with pytest.raises(ComponentFailed, match="nu_dot"):
        env.reset(seed=seed)
    with pytest.raises(InputInvalid, match="expected reset"):
        env.step(np.zeros(3))
    env.reset()
    assert not env.step(np.zeros(3))[2]
    env.close()


@pytest.mark.parametrize("processes", [0, 2])
def test_a_component_that_refuses_its_start_ends_alone(tmp_path: Path, processes: int) -> None:
    file = tmp_path / "picky.py"
    file.write_text(
        "class Picky:\n"
        "    inputs = {'u': '1'}\n"
        "    outputs = {'x': '1'}\n"
        "    parameters = {'p': (1.0, '1')}\n"
        "    def initialize(self, t):\n"
        "        if self.p < 0.3:\n"
        "            raise ValueError('bad p')\n"
        "        return {'x': self.p}\n"
        "    def step(self, t, dt, u):\n"
        "        return {'x': self.p + u['u']}\n"
    )
    task = FunctionTask(
        System("picky", "0.1").add("a", f"{file}:Picky"),
        actions=[Channel("a.u", -1, 1)],
        observations=["a.x"],
        reward=lambda m: m["a.x"],
        action_step="0.1",
        horizon="0.3",
        start=lambda draws: {"a.p": wild(draws)},
    )
    env = CosimVectorEnv(task, N, processes=processes)
    seen, _ = env.reset(seed=0)
    bad = np.array([fails(i, 0) for i in range(N)])
    assert 0 < bad.sum() < N
    np.testing.assert_array_equal(seen[bad], 0.0)
    assert (seen[~bad] >= 0.3).all()
    _, _, terminated, _, infos = env.step(np.zeros((N, 1)))
    np.testing.assert_array_equal(terminated, bad)
    assert all("bad p" in infos["failure"][i] for i in np.flatnonzero(bad))
    env.close()


class WildTeam(Advance):
    def start(self, draws: Draws) -> Mapping[str, Any]:
        nu = np.zeros((draws.n, 6))
        nu[:, 0] = np.where(wild(draws) < 0.3, 1e200, 0.0)
        return {**super().start(draws), "rov_1.hull.nu_0": nu}


def test_a_team_whose_start_fails_ends_alone() -> None:
    env = CosimTeamVectorEnv(WildTeam(2), N)
    env.reset(seed=0)
    bad = np.array([fails(i, 0) for i in range(N)])
    assert env.present.all()
    _, rewards, terminated, _, infos = env.step(np.zeros(env.action_space.shape))
    np.testing.assert_array_equal(terminated, np.stack([bad, bad], axis=1))
    assert (rewards[bad] == 0).all()
    assert infos["_failure"].tolist() == bad.tolist()
    env.close()


@EACH
def test_a_value_outside_its_range_names_the_environment(kind: str) -> None:
    env = CosimVectorEnv(Drift(), 3, **KINDS[kind])
    masses = np.array([11.0, -1.0, 11.0])
    with pytest.raises(InputInvalid, match=r"'hull.m': -1.0 in environment 1; expected finite"):
        env.reset(seed=1, options={"start": {"hull.m": masses}})
    env.reset(seed=1)
    env.close()


def test_the_reward_of_a_failure_is_the_tasks(first_order_fmi3: Path) -> None:
    from tests.envs.drift import Lag

    task = Lag(first_order_fmi3, fault=2)
    task.failure_reward = -7.0
    env = CosimEnv(task)
    env.reset(seed=1)
    terminated = False
    while not terminated:
        _, reward, terminated, _, info = env.step(np.ones(1))
    assert reward == -7.0
    assert "too hot" in info["failure"]
    env.close()
    task.failure_reward = np.nan
    with pytest.raises(InputInvalid, match="failure_reward: nan; expected a finite number"):
        CosimEnv(task)
