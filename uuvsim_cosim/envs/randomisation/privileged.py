"""Privileged observations: a task whose observation includes the drawn parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final, overload

import numpy as np

from uuvsim_cosim.envs.randomisation.randomisation import Randomisation
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Moment, Task, TeamTask
from uuvsim_cosim.errors import InputInvalid

__all__ = ["with_privileged"]


@overload
def with_privileged(task: Task) -> PrivilegedTask: ...
@overload
def with_privileged(task: TeamTask) -> PrivilegedTeamTask: ...


def with_privileged(task: Task | TeamTask) -> PrivilegedTask | PrivilegedTeamTask:
    """Return a `task` whose observation ends with the drawn parameters, scaled to [-1, 1].

    They are the last `privileged_width` numbers of the observation, so that they can be given to a
    critic and hidden from an actor. In a team, they end each agent's observation and the state.
    Raises InputInvalid for a task without a Randomisation.

    Example:

    >>> from uuvsim_cosim.envs import CosimEnv, Randomisation, Uniform, Vary, with_privileged
    >>> from uuvsim_cosim.envs.tasks import StationKeeping
    >>> drawn = Randomisation([Vary("hull.m", Uniform(12.5, 14.5))])  # kg
    >>> task = with_privileged(StationKeeping(randomisation=drawn))
    >>> task.privileged_width
    1
    >>> observation, _ = CosimEnv(task).reset(seed=0)
    >>> observation.shape, observation[-1].round(2)  # -1 is 12.5 kg, 1 is 14.5 kg
    ((21,), np.float32(0.14))
    """
    return PrivilegedTeamTask(task) if isinstance(task, TeamTask) else PrivilegedTask(task)


class _Wrapper:
    """The methods that both tasks below leave to the task that they wrap."""

    task: Any

    def __init__(self, task: Task | TeamTask, **options: Any) -> None:
        drawn = task.randomisation
        if not isinstance(drawn, Randomisation):
            raise InputInvalid(
                type(task).__name__, "draws nothing by a Randomisation", "a task with one"
            )
        self.task = task
        self.drawn = drawn.bound(task.system)
        self.privileged_width = len(self.drawn.privileged_names)
        self.failure_reward = task.failure_reward
        super().__init__(
            task.system,  # type: ignore[call-arg]
            action_step=task.action_step,
            horizon=task.horizon,
            signals=task.signals,
            randomisation=self.drawn,
            **options,
        )

    def start(self, draws: Draws) -> Any:
        """Delegate to the task."""
        return self.task.start(draws)

    def reward(self, m: Moment) -> Any:
        """Delegate to the task."""
        return self.task.reward(m)

    def terminated(self, m: Moment) -> Any:
        """Delegate to the task."""
        return self.task.terminated(m)

    def info(self, m: Moment) -> Any:
        """Delegate to the task."""
        return self.task.info(m)

    def view(self, m: Moment, row: int) -> Any:
        """Delegate to the task."""
        return self.task.view(m, row)


@final
class PrivilegedTask(_Wrapper, Task):
    """A task whose `extra` ends with the parameters that its Randomisation draws."""

    def __init__(self, task: Task) -> None:
        super().__init__(task, actions=task.actions, observations=task.observations)

    def extra(self, m: Moment) -> Array:
        """Return the task's own, then the drawn parameters."""
        own = self.task.extra(m)
        seen = self.drawn.privileged(m.start)
        return seen if own is None else np.concatenate([own, seen], axis=1)

    @property
    def extra_limits(self) -> tuple[Sequence[float], Sequence[float]]:
        """The task's own, then -1 and 1."""
        low, high = self.task.extra_limits
        least, most = self.drawn.privileged_limits
        return [*low, *least.tolist()], [*high, *most.tolist()]


@final
class PrivilegedTeamTask(_Wrapper, TeamTask):
    """A team's task whose observations and state end with the drawn parameters."""

    def __init__(self, task: TeamTask) -> None:
        super().__init__(task, agents=task.agents, actions=task.actions)
        self.team_reward = task.team_reward

    def limits(self, agent: str) -> tuple[Array, Array]:
        """Return the task's own, then -1 and 1."""
        return self._longer(self.task.limits(agent))

    def observe(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's own observation, then the drawn parameters."""
        seen = self.drawn.privileged(m.start)
        own = self.task.observe(m)
        return {agent: np.concatenate([own[agent], seen], axis=1) for agent in self.agents}

    def state(self, m: Moment) -> Array:
        """Return the task's own, then the drawn parameters."""
        return np.concatenate([self.task.state(m), self.drawn.privileged(m.start)], axis=1)

    def state_limits(self) -> tuple[Array, Array]:
        """Return the task's own, then -1 and 1."""
        return self._longer(self.task.state_limits())

    def present(self, m: Moment) -> Any:
        """Delegate to the task."""
        return self.task.present(m)

    def _longer(self, own: tuple[Array, Array]) -> tuple[Array, Array]:
        (low, high), (least, most) = own, self.drawn.privileged_limits
        return np.concatenate([low, least]), np.concatenate([high, most])
