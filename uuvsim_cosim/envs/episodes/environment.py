"""Common part of the four environments: each owns a simulation until it is closed."""

from __future__ import annotations

from copy import copy
from typing import Any, Generic, TypeVar

from gymnasium.envs.registration import EnvSpec

from uuvsim_cosim.envs.episodes.multi_agent import TeamSimulation
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.pictures.screen import Screen
from uuvsim_cosim.envs.task.task import Task
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Environment", "LimitedSpec"]

S = TypeVar("S", bound=TaskSimulation | TeamSimulation)


class Environment(Generic[S]):
    """An environment that owns a simulation, and continues its episodes in a pickled copy."""

    _simulation: S | None = None
    _screen = Screen(None)  # draws nothing
    _closed = ("the environment is closed", "a new one")

    def close(self) -> None:
        """End the simulation and free its memory; a second call does nothing."""
        self._screen.close()
        simulation, self._simulation = self._simulation, None
        if simulation is not None:
            simulation.episodes.close()

    def __del__(self) -> None:
        """Free everything."""
        if self._simulation is not None:
            self.close()

    def _live(self) -> S:
        """Return the simulation; raises InputInvalid if it is closed."""
        if self._simulation is None:
            raise InputInvalid(*self._closed)
        return self._simulation

    def _state(self, **state: object) -> dict[str, object]:
        """Return the state of a copy, with the seeds and counters of the episodes."""
        if self._simulation is not None and self._simulation.episodes.seeded:
            episodes = self._simulation.episodes
            state["counters"] = (episodes.seeds, episodes.episodes)
        return state

    def _continue(self, state: dict[str, Any]) -> None:
        """Continue with the episodes after those of a state."""
        if "counters" in state:
            self._live().episodes.count(*state["counters"])


class LimitedSpec:
    """An environment whose spec has the task's number of steps; no wrapper counts them."""

    task: Task

    @property
    def spec(self) -> EnvSpec | None:
        """The spec of `gymnasium.make`, with the number of steps of an episode, or None.

        Example:

        >>> import gymnasium
        >>> import uuvsim_cosim.envs
        >>> env = gymnasium.make("uuvsim/StationKeeping-v0")
        >>> env.unwrapped.spec.max_episode_steps  # 20 s of actions that take 0.1 s
        200
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = copy(spec)
            spec.max_episode_steps = int(self.task.horizon / self.task.action_step)
        self._spec = spec
