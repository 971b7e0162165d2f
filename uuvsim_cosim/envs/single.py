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
    """A task in its system, run by a fused kernel or, with backend "master", by a master.

    Actions are numbers in [-1, 1], those beyond are clipped; they scale to the limits of the
    task's channels. `reset(options={"start": {"hull.eta_0": …}})` sets start values by name.
    Raises InputInvalid and SystemInvalid for a task that does not fit its system; a reset raises
    ComponentFailed if the episode cannot start, and the next one begins the next episode.
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
        """Make an environment of a system, or a file of one, and functions; see `FunctionTask`."""
        from uuvsim_cosim.envs.task.function_task import FunctionTask

        refuse_options("CosimEnv.of", FunctionTask, {"system": system, **task})
        return cls(FunctionTask(system, **task), render_mode=render_mode, backend=backend)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, object] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin episode 0 of a seed, or without one the next episode of the same seed."""
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
        """Act for one action step."""
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
        """The seconds since the reset."""
        return float(self._live().episodes.moment.time[0])

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the present moment; returns pixels, or None where a window shows them."""
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
