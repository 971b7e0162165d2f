"""Episodes of a task of several agents: which are present, what each observes, who has ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar, Unpack, final

import gymnasium
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.episodes import Episodes
from uuvsim_cosim.envs.episodes.spaces import ActionBox
from uuvsim_cosim.envs.pictures.screen import hulls
from uuvsim_cosim.envs.plants.choice import PlantOptions
from uuvsim_cosim.envs.task.checks import check_failure_reward, infos_of, refuse_infinite
from uuvsim_cosim.envs.task.expressions import Given
from uuvsim_cosim.envs.task.signals import Instant, Signals
from uuvsim_cosim.envs.task.task import Array, Mask, TeamTask
from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.orchestrator.plan.flatten import flatten

__all__ = ["TeamMoment", "TeamSimulation"]

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True)
class TeamMoment:
    """The results of a step, or of a reset: masks of shape (n, agents), and arrays by agent."""

    moment: Instant
    acted: Mask  # agents whose action led here
    seen: Mask  # agents that get an observation: those that acted, and those that have come
    present: Mask  # agents that act next
    observation: Mapping[str, NDArray[np.float32]]
    reward: Array  # (n, agents), 0 for those that did not act
    terminated: Mask
    truncated: Mask

    @property
    def over(self) -> Mask:
        """The episodes that have ended, of shape (n,): no agent is present any more."""
        return np.asarray(~self.present.any(axis=1))


@final
class TeamSimulation:
    """The common part of CosimParallelEnv and CosimTeamVectorEnv: a task, its episodes, spaces.

    An agent that has ended does not come back in its episode, and one that is not `present` any
    more is truncated. While an agent does not act, its inputs are in the middle of their limits.
    """

    def __init__(
        self, task: TeamTask, n: int, *, drawn: bool = False, **options: Unpack[PlantOptions]
    ) -> None:
        if not isinstance(task, TeamTask):
            raise InputInvalid(
                f"task {task!r}", "a TeamTask (for a Task: CosimEnv or CosimVectorEnv)"
            )
        self.task, self.agents, self.n = task, task.agents, n
        self.place = f"task {type(task).__name__}"
        plan = flatten(task.system)
        poses = [f"{path}.eta" for path in hulls(plan)] if drawn else []
        signals = Signals(plan, [*task.signals, *poses])
        self.boxes = {agent: ActionBox(plan, task.actions[agent]) for agent in self.agents}
        self.spaces = {a: self._space(task.limits(a), f"limits({a!r})") for a in self.agents}
        self.state_space = self._space(task.state_limits(), "state_limits()")
        problems = [
            *self._problems(task),
            *signals.problems,
            *check_failure_reward(task.failure_reward),
        ]
        self.episodes = Episodes(task, n, signals, self.boxes, problems, **options)
        self._given = Given(task)
        self._gone = np.zeros((n, len(self.agents)), bool)
        self._now: TeamMoment | None = None

    @property
    def now(self) -> TeamMoment:
        """The results of the last step or reset."""
        if self._now is None:
            raise InputInvalid(self.place, "no episode has begun", "reset() first")
        return self._now

    def reset(
        self,
        mask: Mask | None = None,
        *,
        seeds: Sequence[int] | None = None,
        start: Mapping[str, object] | None = None,
    ) -> TeamMoment:
        """Begin episodes where the mask is true; raises InputInvalid if no agent is present."""
        m = self.episodes.reset(mask, seeds=seeds, start=start)
        old = self._now
        here = self._by_agent(self.task.present(m), "present()", np.bool_)
        fresh = np.ones(self.n, bool) if mask is None or old is None else mask
        if self.episodes.stillborn is not None:
            # All agents stay present for one step, which reports the failed start to them.
            here |= self.episodes.stillborn[:, None]
        empty = fresh & ~here.any(axis=1)
        if empty.any():
            raise InputInvalid(
                self.place,
                "present() gives no agent at the start of an episode",
                f"at least one of {', '.join(self.agents)}",
            )
        which = fresh[:, None]
        self._gone &= ~which
        none = np.zeros_like(here)
        if old is None:
            old = TeamMoment(m, none, none, none, {}, none * 0.0, none, none)
        seen = np.where(which, here, old.seen)
        self._now = TeamMoment(
            moment=m,
            acted=old.acted & ~which,
            seen=seen,
            present=np.where(which, here, old.present),
            observation=self._observe(m),
            reward=np.where(which, 0.0, old.reward),
            terminated=old.terminated & ~which,
            truncated=old.truncated & ~which,
        )
        return self._now

    def act(self, actions: Mapping[str, object]) -> TeamMoment:
        """Act for one action step; `actions` by agent, of shape (n, width). Raises InputInvalid."""
        acting = self.now.present
        checked = {}
        for j, (agent, box) in enumerate(self.boxes.items()):
            place = f"{self.place}, agent {agent!r}"
            given = box.checked(actions[agent], self.n, place)
            checked[agent] = np.where(acting[:, j, None], given, 0.0)
        m = self.episodes.step(checked)
        failed, over = self.episodes.failed[:, None], self.episodes.over[:, None]
        here = self._by_agent(self.task.present(m), "present()", np.bool_)
        terminated = self._by_agent(self._given("terminated", m), "terminated()", np.bool_)
        terminated = acting & (terminated | failed)
        truncated = acting & (over | ~here) & ~terminated
        come = here & ~acting & ~self._gone & ~failed & ~over
        self._gone |= terminated | truncated
        reward = self._by_agent(self._given("reward", m), "reward()", np.float64)
        acted = np.where(acting, self.episodes.rewarded(reward.T).T, 0.0)
        for j, agent in enumerate(self.agents):
            refuse_infinite(acted[:, j], f"{self.place}: reward(), {agent!r},")
        self._now = TeamMoment(
            moment=m,
            acted=acting,
            seen=acting | come,
            present=(acting | come) & ~terminated & ~truncated,
            observation=self._observe(m),
            reward=acted,
            terminated=terminated,
            truncated=truncated,
        )
        return self._now

    def info(self, m: Instant) -> Mapping[str, NDArray[np.generic]]:
        """Return the task's infos, of shape (n, …)."""
        return infos_of(self._given("info", m), m.n, self.place)

    def state(self) -> NDArray[np.float32]:
        """Return the state for a central critic, of shape (n, width)."""
        return self._clipped(self.task.state(self.now.moment), self.state_space, "state()")

    # ---- inside ---------------------------------------------------------------------------

    def _observe(self, m: Instant) -> dict[str, NDArray[np.float32]]:
        given = self._given("observe", m)
        self._check_agents(given, "observe()")
        return {a: self._clipped(given[a], self.spaces[a], f"observe(), {a!r}")
                for a in self.agents}  # fmt: skip

    def _clipped(
        self, values: object, space: gymnasium.spaces.Box, place: str
    ) -> NDArray[np.float32]:
        numbers = np.asarray(values, dtype=np.float32)
        expected = (self.n, *space.shape)
        if numbers.shape != expected:
            read = f"{place} of shape {numbers.shape}"
            raise InputInvalid(self.place, read, f"{expected}, as for its limits")
        if self.episodes.stillborn is not None:
            numbers = np.where(self.episodes.stillborn[:, None], np.float32(0), numbers)
        refuse_infinite(numbers, f"{self.place}: {place}")
        return np.asarray(np.clip(numbers, space.low, space.high))

    def _by_agent(self, given: Mapping[str, NDArray[T]], place: str, dtype: type[T]) -> NDArray[T]:
        """Return values by agent as columns, of shape (n, agents)."""
        self._check_agents(given, place)
        result = np.empty((self.n, len(self.agents)), dtype)
        for j, agent in enumerate(self.agents):
            column = np.asarray(given[agent])
            if column.shape != (self.n,) or (dtype is np.bool_ and column.dtype != bool):
                wanted = "Booleans" if dtype is np.bool_ else "numbers"
                raise InputInvalid(
                    self.place,
                    f"{place}, {agent!r}, of type {column.dtype} and shape {column.shape}",
                    f"{wanted} of shape {(self.n,)}",
                )
            result[:, j] = column
        return result

    def _check_agents(self, given: Mapping[str, object], place: str) -> None:
        missing = [a for a in self.agents if a not in given]
        if missing:
            raise InputInvalid(
                self.place,
                f"{place} has nothing for {', '.join(map(repr, missing))}",
                f"an entry for each of {', '.join(self.agents)}, also for those that are absent",
            )

    def _space(self, limits: tuple[object, object], place: str) -> gymnasium.spaces.Box:
        low, high = (np.asarray(side, np.float32) for side in limits)
        if low.ndim != 1 or low.shape != high.shape or not np.all(low <= high):
            raise InputInvalid(
                self.place,
                f"{place} of shapes {low.shape} and {high.shape}",
                "the least and the greatest value of each number",
            )
        return gymnasium.spaces.Box(low, high, dtype=np.float32)

    def _problems(self, task: TeamTask) -> list[Problem]:
        problems: list[Problem] = []
        owner: dict[tuple[str, int], str] = {}
        without: list[str] = []
        for agent, box in self.boxes.items():
            problems += [
                Problem(f"agent {agent!r}, {p.place}", p.read, p.expected) for p in box.problems
            ]
            if box.problems and not box.targets:
                without.append(agent)
            for column, target in enumerate(box.targets):
                if target in owner:
                    read = f"acts on {box.name(column)!r}, as {owner[target]!r} does"
                    problems.append(Problem(f"agent {agent!r}", read, "a vehicle of its own"))
                owner[target] = agent
        if without:
            names = ", ".join(map(repr, without))
            read = f"{len(self.agents)}, of which {names} cannot act in {task.system.name!r}"
            expected = f"at most {len(self.agents) - len(without)}, or a system with more vehicles"
            problems.insert(0, Problem("agents", read, expected))
        return problems
