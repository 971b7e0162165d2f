"""Stable-Baselines3's VecEnv over the arrays of a CosimVectorEnv, without copies.

>>> model = PPO("MlpPolicy", Sb3VecEnv(task, 64))  # doctest: +SKIP
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, final

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.envs.vector import CosimVectorEnv
from uuvsim_cosim.errors import InputInvalid

try:
    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn
except ModuleNotFoundError as error:
    raise InputInvalid(error, "stable-baselines3: pip install stable-baselines3") from error

__all__ = ["Sb3VecEnv"]

Indices = None | int | Iterable[int]


@final
class Sb3VecEnv(VecEnv):
    """`num_envs` environments of a task, in one kernel where it can be fused.

    A team's task is acted on by one central agent (see `Solo`). Options are CosimVectorEnv's. The
    info of an ended episode has its last observation ("terminal_observation"), whether the horizon
    ended it ("TimeLimit.truncated"), and the task's infos of the last step.
    """

    def __init__(self, task: Task | TeamTask, num_envs: int, **options: Any) -> None:
        if isinstance(task, TeamTask):
            from uuvsim_cosim.envs.solo import Solo

            task = Solo(task)
        if "autoreset_mode" in options:
            raise InputInvalid("autoreset_mode", "is SAME_STEP here", "other options")
        self.vector = CosimVectorEnv(
            task, num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options
        )
        self._seed: int | None = None
        self._actions: NDArray[np.generic] | None = None
        super().__init__(
            num_envs, self.vector.single_observation_space, self.vector.single_action_space
        )

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seed of the next reset: s, s + 1, …."""
        self._seed = seed
        return [None if seed is None else seed + i for i in range(self.num_envs)]

    def reset(self) -> NDArray[np.float32]:
        """Begin the first episodes of the seed, if one was set, else the next episodes."""
        observations, _ = self.vector.reset(seed=self._seed)
        self._seed = None
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return observations

    def step_async(self, actions: NDArray[np.generic]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Act; an environment whose episode ends returns the first observation of the next one."""
        assert self._actions is not None
        observations, rewards, terminated, truncated, given = self.vector.step(self._actions)
        ended = terminated | truncated
        infos: list[dict[str, object]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(ended).tolist():
            last = given["final_info"]
            infos[i] = {
                k: v[i] for k, v in last.items() if not k.startswith("_") and last[f"_{k}"][i]
            }
            infos[i]["terminal_observation"] = given["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i])
        return observations, rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        self.vector.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[object]:
        """Return an attribute, the same for all environments."""
        return [getattr(self.vector, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: object, indices: Indices = None) -> None:
        """Refuse: the environments share their attributes."""
        raise InputInvalid(attr_name, "environments of one kernel share it", "a new task")

    def env_method(
        self,
        method_name: str,
        *method_args: object,
        indices: Indices = None,
        **method_kwargs: object,
    ) -> list[object]:
        """Refuse: there is one object for all environments."""
        raise InputInvalid(
            method_name, "cannot be called of single environments", "a call on `vector`"
        )

    def env_is_wrapped(self, wrapper_class: type[object], indices: Indices = None) -> list[bool]:
        """Return False for each environment."""
        return [False] * len(list(self._get_indices(indices)))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Draw each environment."""
        return self.vector.render() or [None] * self.num_envs
