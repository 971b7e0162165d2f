"""A task of one agent on its episodes: observations, rewards, ends and infos of n environments."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Unpack, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.episodes import AGENT, Episodes
from uuvsim_cosim.envs.episodes.spaces import ActionBox, ObservationBox
from uuvsim_cosim.envs.pictures.screen import hulls
from uuvsim_cosim.envs.plants.choice import PlantOptions
from uuvsim_cosim.envs.task.checks import (
    check_failure_reward,
    infos_of,
    refuse_infinite,
    rewards_of,
)
from uuvsim_cosim.envs.task.expressions import Given
from uuvsim_cosim.envs.task.signals import Instant, Signals
from uuvsim_cosim.envs.task.task import Array, Task
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten

__all__ = ["TaskSimulation"]


@final
class TaskSimulation:
    """The common part of CosimEnv and CosimVectorEnv: a task, its episodes and its spaces.

    Raises InputInvalid for a task that does not fit its system.
    """

    def __init__(
        self, task: Task, n: int, *, drawn: bool = False, **options: Unpack[PlantOptions]
    ) -> None:
        if not isinstance(task, Task):
            raise InputInvalid(
                f"task {task!r}", "a Task (for a TeamTask: CosimParallelEnv, or Solo)"
            )
        self.task = task
        self.place = f"task {type(task).__name__}"
        plan = flatten(task.system)
        names = [*(c.name for c in task.observations), *task.signals]
        names += [f"{path}.eta" for path in hulls(plan)] if drawn else []
        signals = Signals(plan, names)
        self.action_box = ActionBox(plan, task.actions)
        # An observation with an unknown name is reported once, as a signal.
        unknown = {p.place for p in signals.problems}
        observed = [c for c in task.observations if f"signal {c.name!r}" not in unknown]
        self.observation_box = ObservationBox(plan, signals, observed, task.extra_limits)
        none = [] if observed == list(task.observations) else ["observations"]
        problems = [
            *self.action_box.problems,
            *signals.problems,
            *(p for p in self.observation_box.problems if p.place not in none),
            *check_failure_reward(task.failure_reward),
        ]
        boxes = {AGENT: self.action_box}
        self.episodes = Episodes(task, n, signals, boxes, problems, **options)
        self._given = Given(task)

    def act(
        self, actions: object, again: NDArray[np.bool_] | None = None, *, alone: bool = False
    ) -> Instant:
        """Check the actions and act; where `again` is true, begin the next episodes instead.

        With `alone`, the action has no axis of environments. Raises InputInvalid.
        """
        n = None if alone else self.episodes.n
        checked = self.action_box.checked(actions, n, self.place)
        return self.episodes.step({AGENT: checked}, again)

    def observe(self, m: Instant) -> NDArray[np.float32]:
        """Return the observations, of shape (n, width)."""
        if self.episodes.stillborn is None:
            compiled = self._given.observations(m)
            if compiled is not None:
                return compiled
        extra = self._given("extra", m) if self.observation_box.n_extra else None
        try:
            return self.observation_box.of(m.values, extra, self.episodes.stillborn)
        except InputInvalid as error:
            raise InputInvalid(f"{self.place}: {error}") from None

    def reward(self, m: Instant) -> Array:
        """Return the rewards, of shape (n,); the task's `failure_reward` after a failure."""
        reward = rewards_of(self._given("reward", m), m.n, f"{self.place}: reward()")
        reward = self.episodes.rewarded(reward)
        refuse_infinite(reward, f"{self.place}: reward()")
        return reward

    def terminated(self, m: Instant) -> NDArray[np.bool_]:
        """Return which episodes have terminated, by the task or by a failure."""
        ended = np.asarray(self._given("terminated", m))
        if ended.shape != (m.n,) or ended.dtype != bool:
            raise InputInvalid(
                self.place,
                f"terminated() of type {ended.dtype} and shape {ended.shape}",
                f"Booleans of shape {(m.n,)}",
            )
        return ended | self.episodes.failed if self.episodes.any_failed else ended

    def info(self, m: Instant) -> Mapping[str, NDArray[np.generic]]:
        """Return the task's infos, of shape (n, …)."""
        return infos_of(self._given("info", m), m.n, self.place)
