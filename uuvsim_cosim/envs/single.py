"""One environment of any system: Gymnasium's Env over a task."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.environment import Environment, LimitedSpec
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.pictures.screen import Screen
from uuvsim_cosim.envs.plants.choice import Backend
from uuvsim_cosim.envs.task.checks import base_seed, refuse_options, start_of
from uuvsim_cosim.envs.task.task import Task
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["CosimEnv"]

Observation = NDArray[np.float32]


@final
class CosimEnv(
    LimitedSpec, Environment[TaskSimulation], gymnasium.Env[Observation, NDArray[np.generic]]
):
    """Environment of one agent: a task in its system, with the interface of Gymnasium's `Env`.

    `task` is a `Task`; for a `TeamTask`, use `CosimParallelEnv`, or `Solo`. With `backend` "auto",
    a fused kernel runs the system if possible, else a master; "kernel" and "master" require one of
    them. `render_mode` is "rgb_array", "human" (a window) or None.

    An action is an array of shape (width of the action,) of numbers in [-1, 1], which are scaled to
    the limits of the task's channels; numbers outside of [-1, 1] are clipped. An observation is a
    float32 array of shape (width of the observation,). The attributes `action_space` and
    `observation_space` hold these widths and the limits. If a component fails, the step returns
    `terminated`, the last valid observation and a message in `info["failure"]`.

    Raises InputInvalid and SystemInvalid for a task that does not fit its system.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import CosimEnv
    >>> from uuvsim_cosim.envs.tasks import StationKeeping
    >>> env = CosimEnv(StationKeeping())  # hold a BlueROV2 Heavy at 10 m depth, in a current
    >>> observation, info = env.reset(seed=0)
    >>> env.action_space.shape, env.observation_space.shape  # three forces and three moments
    ((6,), (20,))
    >>> observation, reward, terminated, truncated, info = env.step(np.zeros(6))
    >>> env.time, info["position_error"].round(2)  # s, m
    (0.1, np.float64(0.58))
    >>> env.close()
    """

    metadata: ClassVar[dict[str, object]] = {"render_modes": ["rgb_array", "human"]}  # type: ignore[misc]

    def __init__(
        self, task: Task, render_mode: str | None = None, backend: Backend = "auto"
    ) -> None:
        self._screen = Screen(render_mode)
        self._simulation = TaskSimulation(task, 1, backend=backend, drawn=render_mode is not None)
        self.task = task
        self.spec = None
        self.render_mode = render_mode
        self.backend = backend
        self.metadata = {**self.metadata, "render_fps": float(1 / task.action_step)}  # type: ignore[misc]
        box, width = self._simulation.observation_box, self._simulation.action_box.width
        self.observation_space = gymnasium.spaces.Box(box.low, box.high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (width,), np.float32)
        self._ended = False

    @classmethod
    def of(
        cls,
        system: System | str | Path,
        *,
        render_mode: str | None = None,
        backend: Backend = "auto",
        **task: Any,
    ) -> CosimEnv:
        """Make an environment of a `system`, or of the file of a system, and functions.

        `task` are the arguments of `FunctionTask`. `render_mode` and `backend` are those of the
        class. Raises InputInvalid for an unknown argument.

        Example:

        >>> import numpy as np
        >>> from uuvsim_cosim.envs import Channel, CosimEnv
        >>> env = CosimEnv.of(
        ...     "bluerov2_task",
        ...     actions=[Channel("allocation.tau_d[3]", -100, 100, "N")],
        ...     observations=["hull.eta[3]"],  # the depth [m]
        ...     reward=lambda m: -np.abs(m["hull.eta"][:, 2] - 12.0),  # reach a depth of 12 m
        ...     action_step="0.1",
        ...     horizon=20,
        ... )
        >>> observation, _ = env.reset(seed=0)
        >>> observation
        array([10.], dtype=float32)
        """
        from uuvsim_cosim.envs.task.function_task import FunctionTask

        refuse_options("CosimEnv.of", FunctionTask, {"system": system, **task})
        return cls(FunctionTask(system, **task), render_mode=render_mode, backend=backend)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, object] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; return the first observation and the task's infos.

        With a `seed` from 0 to 2^64 - 1, it is episode 0 of this seed; without, the next episode of
        the same seed. `options` may be `{"start": {…}}`: start values by name, for this episode.
        Raises InputInvalid for other options and for values that do not fit, and ComponentFailed if
        the episode cannot start; the reset after that begins the next episode.

        Example:

        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> env = CosimEnv(StationKeeping())
        >>> start = {"hull.eta_0": [1.0, 0.0, 10.0, 0.0, 0.0, 0.0]}  # N E D [m], angles [rad]
        >>> observation, info = env.reset(seed=0, options={"start": start})
        >>> info["position_error"]  # m
        np.float64(1.0)
        """
        simulation = self._live()
        start = start_of(options, mask="a vector in autoreset mode 'Disabled'")
        if seed is not None:
            seed = base_seed(seed)
        super().reset(seed=seed)
        seeds = None
        if seed is not None or not simulation.episodes.seeded:
            seeds = [self.np_random_seed if seed is None else seed]
        m = simulation.episodes.reset(seeds=seeds, start=start)
        self._ended = False
        result = simulation.observe(m)[0], _row(simulation.info(m))
        self._screen.changed(self.render)
        return result

    def step(
        self, action: NDArray[np.generic]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Act for one action step; return observation, reward, terminated, truncated and infos.

        `action` has the shape (width of the action,). Raises InputInvalid for another shape, for
        NaN, and after the end of an episode.
        """
        simulation = self._live()
        if self._ended or not simulation.episodes.begun:
            had = "the episode has ended" if self._ended else "no episode has begun"
            raise InputInvalid(simulation.place, had, "reset() before step()")
        m = simulation.act(action, alone=True)
        reward = simulation.reward(m)[0].item()
        terminated = bool(simulation.terminated(m)[0])
        truncated = bool(simulation.episodes.over[0]) and not terminated
        info = _row(simulation.info(m))
        if terminated and (failure := simulation.episodes.failure(0)):
            info["failure"] = failure
        self._ended = terminated or truncated
        result = simulation.observe(m)[0], reward, terminated, truncated, info
        self._screen.changed(self.render)
        return result

    @property
    def time(self) -> float:
        """The time since the reset [s]."""
        return float(self._live().episodes.moment.time[0])

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the present state; return pixels (height, width, 3), or None with a window.

        Example:

        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> env = CosimEnv(StationKeeping(), render_mode="rgb_array")
        >>> _ = env.reset(seed=0)
        >>> pixels = env.render()
        >>> pixels.shape, pixels.dtype
        ((480, 640, 3), dtype('uint8'))
        """
        return self._screen.frame(self.task, self._live().episodes.moment, 0)

    def __getstate__(self) -> dict[str, object]:
        """Return the state of a copy that continues with the next episode."""
        return self._state(
            made=(self.task, self.render_mode, self.backend),
            spec=self.spec,
            spaces=(self.action_space, self.observation_space),
            np_random=(self._np_random, self._np_random_seed),
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make a new environment; the next call must be reset()."""
        CosimEnv.__init__(self, *state["made"])
        self.spec = state["spec"]
        self._np_random, self._np_random_seed = state["np_random"]
        self.action_space, self.observation_space = state["spaces"]
        self._continue(state)
        self._ended = "counters" in state


def _row(info: Mapping[str, NDArray[np.generic]]) -> dict[str, object]:
    """Return the infos of one environment, copied."""
    return {k: v[0].copy() for k, v in info.items()}
