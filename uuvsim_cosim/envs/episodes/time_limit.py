"""Number of steps of an episode in Gymnasium's spec, although no wrapper ends the episode."""

from __future__ import annotations

from copy import copy

from gymnasium.envs.registration import EnvSpec

from uuvsim_cosim.envs.task.task import Task

__all__ = ["limited"]


def limited(spec: EnvSpec | None, task: Task) -> EnvSpec | None:
    """Return a spec with the task's number of steps, unless it has one."""
    if spec is None or spec.max_episode_steps is not None:
        return spec
    result = copy(spec)
    result.max_episode_steps = int(task.horizon / task.action_step)
    return result
