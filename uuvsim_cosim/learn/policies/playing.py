"""Pictures of an episode in which a policy acts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.learn.policies.policy import begin

if TYPE_CHECKING:
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.tasks.scripted import Policies, Policy
    from uuvsim_cosim.envs.team import CosimParallelEnv

__all__ = ["frames_of"]

Pixels = NDArray[np.uint8]


def frames_of(
    task: Task | TeamTask,
    policy: Policies,
    seed: int,
    mode: Literal["rgb_array", "human"] = "rgb_array",
) -> Iterator[Pixels]:
    """Yield the pictures (height, width, 3) of episode 0 of a seed, from its start to its end.

    `policy` has the form that `evaluate` expects, and the episode is the same. In mode "human", a
    window shows the pictures, and none are yielded.
    """
    for one in policy.values() if isinstance(policy, Mapping) else (policy,):
        begin(one)
    if isinstance(task, TeamTask):
        assert isinstance(policy, Mapping)
        from uuvsim_cosim.envs.team import CosimParallelEnv

        team = CosimParallelEnv(task, render_mode=mode)
        try:
            seen, _ = team.reset(seed=seed)
            yield from _drawn(team)
            while team.agents:
                acts = {a: _one(policy[a], seen[a]) for a in team.agents}
                seen, *_ = team.step(acts)
                yield from _drawn(team)
        finally:
            team.close()
        return
    assert not isinstance(policy, Mapping)
    from uuvsim_cosim.envs.single import CosimEnv

    env = CosimEnv(task, render_mode=mode)
    try:
        observation, _ = env.reset(seed=seed)
        yield from _drawn(env)
        over = False
        while not over:
            step = env.step(_one(policy, observation))
            observation, over = step[0], bool(step[2] or step[3])
            yield from _drawn(env)
    finally:
        env.close()


def _one(policy: Policy, observation: NDArray[np.float32]) -> NDArray[np.float32]:
    """Act on one observation; actions are rounded to float32, as in `Rollout`."""
    return np.asarray(policy(observation[None])[0], np.float32)


def _drawn(env: CosimEnv | CosimParallelEnv) -> Iterator[Pixels]:
    if env.render_mode == "rgb_array":  # a window shows each step without being asked
        pixels = env.render()
        assert pixels is not None
        yield pixels
