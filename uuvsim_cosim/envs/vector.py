"""Many environments of any system: Gymnasium's VectorEnv over a task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, final

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from uuvsim_cosim.envs import vector_info
from uuvsim_cosim.envs.episodes.environment import Environment, LimitedSpec
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.pictures.screen import Screen
from uuvsim_cosim.envs.plants.choice import Backend, DType
from uuvsim_cosim.envs.task.checks import base_seed, whole
from uuvsim_cosim.envs.task.signals import Instant
from uuvsim_cosim.envs.task.task import Mask, Task
from uuvsim_cosim.errors import InputInvalid

__all__ = ["CosimVectorEnv"]

Observations = NDArray[np.float32]
Array = NDArray[np.generic]
Step = tuple[Observations, NDArray[np.float64], Mask, Mask, dict[str, Any]]


@final
class CosimVectorEnv(
    LimitedSpec, VectorEnv[Observations, Array, Array], Environment[TaskSimulation]
):
    """Vector of n = `num_envs` environments of one agent, as Gymnasium's `VectorEnv`.

    Each runs a `task` in a copy of its system. Environment i of seed s has the same bits as
    `CosimEnv` of seed s + i. `backend` is that of `CosimEnv`: a fused kernel runs all environments
    in `threads` threads, with numbers of type `dtype` ("float64" or "float32"); masters run in
    `processes` worker processes (by default one for each core; 0: in this process). `render_mode`
    is "rgb_array" or None.

    Actions are arrays (n, width of the action) of numbers in [-1, 1], observations float32 arrays
    (n, width of the observation); rewards, terminated and truncated have the shape (n,).
    `autoreset_mode` is one of Gymnasium's:

    - "NextStep": the step after the end of an episode is the reset, with reward 0.
    - "SameStep": the step that ends an episode returns the first observation of the next one, and
      the last observation in `infos["final_obs"]`.
    - "Disabled": `reset(options={"reset_mask": mask})` begins the next episodes.

    An environment whose episode cannot start terminates in its first step. Raises InputInvalid and
    SystemInvalid for a task that does not fit its system.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import CosimVectorEnv
    >>> from uuvsim_cosim.envs.tasks import StationKeeping
    >>> envs = CosimVectorEnv(StationKeeping(), num_envs=256)
    >>> observations, infos = envs.reset(seed=0)
    >>> observations, rewards, terminated, truncated, infos = envs.step(np.zeros((256, 6)))
    >>> observations.shape, rewards.shape, terminated.any()
    ((256, 20), (256,), np.False_)
    >>> envs.close()
    """

    _closed = ("the environments are closed", "new ones")
    metadata: ClassVar[dict[str, object]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array"],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        task: Task,
        num_envs: int,
        *,
        render_mode: str | None = None,
        backend: Backend = "auto",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        dtype: DType = "float64",
        processes: int | None = None,
    ) -> None:
        num_envs = whole(num_envs, "num_envs")
        self._mode = vector_info.autoreset_of(autoreset_mode)
        if render_mode == "human":
            raise InputInvalid("render_mode 'human' of many environments", "'rgb_array'")
        self._screen = Screen(render_mode)
        self._made = {
            "task": task, "num_envs": num_envs, "render_mode": render_mode,
            "backend": backend, "autoreset_mode": self._mode, "threads": threads,
            "dtype": dtype, "processes": processes,
        }  # fmt: skip
        self._simulation = TaskSimulation(
            task, num_envs, backend=backend, threads=threads, dtype=dtype,
            processes=processes, drawn=render_mode is not None,
        )  # fmt: skip
        self.task = task
        self.spec = None
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.metadata = {  # type: ignore[misc]
            **self.metadata,
            "autoreset_mode": self._mode,
            "render_fps": float(1 / task.action_step),
        }
        box, width = self._simulation.observation_box, self._simulation.action_box.width
        self.single_observation_space = Box(box.low, box.high, dtype=np.float32)
        self.single_action_space = Box(-1.0, 1.0, (width,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._ended = np.zeros(self.num_envs, bool)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, object] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin episodes; return the first observations and the task's infos.

        With a `seed` s, they are the episodes 0 of the seeds s, s + 1, …; a list has one seed for
        each environment. Without, they are the next episodes of the same seeds. `options` may be
        `{"start": {…}}`, start values by name, of the variable's shape or with n rows, and, with
        autoreset mode "Disabled", `{"reset_mask": mask}` with n Booleans, which selects
        environments.
        Raises InputInvalid for other options, and ComponentFailed if no environment can start.

        Example:

        >>> from uuvsim_cosim.envs import CosimVectorEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> envs = CosimVectorEnv(StationKeeping(), num_envs=2)
        >>> start = {"hull.eta_0": [[1.0, 0, 10.0, 0, 0, 0], [2.0, 0, 10.0, 0, 0, 0]]}  # m, rad
        >>> _, infos = envs.reset(seed=0, options={"start": start})
        >>> infos["position_error"]  # m
        array([1., 2.])
        """
        simulation = self._live()
        start, mask = vector_info.reset_options(options, self._mode, simulation)
        seeds = self._seeds(seed)
        m = simulation.episodes.reset(mask, seeds=seeds, start=start)
        self._ended = np.zeros(self.num_envs, bool) if mask is None else self._ended & ~mask
        infos = vector_info.of(simulation.info(m), mask, self.num_envs)
        return simulation.observe(m), infos

    def step(self, actions: Array) -> Step:
        """Act in all environments for one action step; `actions` are (n, width) in [-1, 1].

        Returns observations, rewards, terminated, truncated and infos. Raises InputInvalid for
        other shapes and for NaN.
        """
        simulation = self._live()
        if not simulation.episodes.begun:
            raise InputInvalid(simulation.place, "no episode has begun", "reset() first")
        ended = self._ended
        again = bool(ended.any())  # whether an episode begins in this step
        if again and self._mode is AutoresetMode.DISABLED:
            vector_info.refuse_ended(simulation.place, ended)
        m = simulation.act(actions, ended if again else None)
        reward, terminated = simulation.reward(m), simulation.terminated(m)
        truncated = simulation.episodes.over & ~terminated
        if again:
            reward = np.where(ended, 0.0, reward)
            terminated, truncated = terminated & ~ended, truncated & ~ended
        infos = vector_info.of(simulation.info(m), None, self.num_envs)
        self._ended = terminated | truncated
        done = bool(self._ended.any())
        if done and terminated.any():
            vector_info.add_failures(infos, simulation.episodes, terminated)
        observations = simulation.observe(m)
        if done and self._mode is AutoresetMode.SAME_STEP:
            ended, self._ended = self._ended, np.zeros(self.num_envs, bool)
            m = simulation.episodes.reset(ended)
            new = simulation.observe(m)
            infos = vector_info.final(infos, observations, ended, simulation.info(m))
            observations = np.where(ended[:, None], new, observations)
        return observations, reward, terminated, truncated, infos

    def render(self) -> tuple[Any, ...] | None:
        """Draw each environment; return n arrays of pixels (height, width, 3).

        Example:

        >>> from uuvsim_cosim.envs import CosimVectorEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> envs = CosimVectorEnv(StationKeeping(), num_envs=2, render_mode="rgb_array")
        >>> _ = envs.reset(seed=0)
        >>> [pixels.shape for pixels in envs.render()]
        [(480, 640, 3), (480, 640, 3)]
        """
        m: Instant = self._live().episodes.moment
        if self.render_mode is None:
            self._screen.frame(self.task, m, 0)  # warns
            return None
        return tuple(self._screen.frame(self.task, m, row) for row in range(self.num_envs))

    def close_extras(self, **kwargs: object) -> None:
        """End the simulation and free its memory; `close` calls it. `kwargs` are ignored.

        Example:

        >>> from uuvsim_cosim.envs import CosimVectorEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> envs = CosimVectorEnv(StationKeeping(), num_envs=2)
        >>> envs.close_extras()
        """
        Environment.close(self)

    def __getstate__(self) -> dict[str, object]:
        """Return the state of copies that continue with the next episodes."""
        spaces = (self.action_space, self.single_action_space,
                  self.observation_space, self.single_observation_space)  # fmt: skip
        return self._state(
            made=self._made,
            spec=self.spec,
            spaces=spaces,
            np_random=(self._np_random, self._np_random_seed),
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make new environments; the next call must be reset()."""
        CosimVectorEnv.__init__(self, **state["made"])
        self.spec = state["spec"]
        self._np_random, self._np_random_seed = state["np_random"]
        (self.action_space, self.single_action_space,
         self.observation_space, self.single_observation_space) = state["spaces"]  # fmt: skip
        self._continue(state)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> NDArray[np.uint64] | None:
        """Return a seed for each environment, or None to continue with the same seeds."""
        n = self.num_envs
        if seed is None and self._live().episodes.seeded:
            return None
        if not isinstance(seed, Sequence | np.ndarray) or isinstance(seed, str):
            given = None if seed is None else base_seed(seed, n)
            super().reset(seed=given)
            own = self.np_random_seed if given is None else given
            assert own is not None
            numbers = [(own + i) % 2**64 for i in range(n)]
        else:
            if len(seed) != n:
                raise InputInvalid("seed", f"{len(seed)} numbers", f"one, or {n}")
            rng = np.random.default_rng()
            numbers = [int(rng.integers(2**63)) if s is None else base_seed(s) for s in seed]
        return np.array(numbers, np.uint64)
