"""A team's task as the task of one central agent, so that a team of one is plain Gymnasium."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.spaces import ActionBox
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Symbols, declared_methods, split_action
from uuvsim_cosim.envs.task.task import Array, Mask, Moment, Task, TeamTask
from uuvsim_cosim.orchestrator.plan.flatten import flatten

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import View

__all__ = ["Solo"]


@final
class Solo(Task):
    """Task of one agent that acts for a whole `team`, with the observations of all its agents.

    A team then runs in `CosimEnv` and with any learner of one agent. Actions and observations are
    concatenated in the order of the team's agents. With more than one agent, the observation of an
    absent agent is zero, and a flag for each agent, 1 or 0, follows the observations. The reward is
    the sum over the present agents, or their mean if each agent is given the reward of the team
    (`team_reward`). The episode is terminated as soon as one agent's is. A component's failure
    gives the team's `failure_reward` once. Methods receive a moment `m` of n environments.

    Example:

    >>> from uuvsim_cosim.envs import CosimEnv, Draws, Solo
    >>> from uuvsim_cosim.envs.tasks import TargetTracking
    >>> class Kept(TargetTracking):  # keeps its last moment, so that the example can use it
    ...     def observe(self, m):
    ...         self.m = m
    ...         return super().observe(m)
    >>> team = Kept(n_trackers=2)  # each of the two acts by 2 numbers and observes 31
    >>> task = Solo(team)
    >>> env = CosimEnv(task)
    >>> _ = env.reset(seed=0)
    >>> env.action_space.shape, env.observation_space.shape
    ((4,), (64,))
    >>> _, reward, *_ = env.step([0.0, 0.0, 0.0, 0.0])
    >>> task.extra(team.m).shape, len(task.extra_limits[1]), task.reward(team.m)[0] == reward
    ((1, 64), 64, np.True_)
    >>> task.terminated(team.m), task.info(team.m)["dist"].round(1)  # distance to the target [m]
    (array([False]), array([1.2]))
    >>> len(task.view(team.m, row=0).vehicles)
    2
    >>> task.expressions(None) is None  # `Kept` overrides a method in NumPy
    True
    >>> sorted(task.start(Draws(seeds=[0], episodes=[0])))[:2]
    ['target.position_0', 'target.psi_0']
    """

    def __init__(self, team: TeamTask) -> None:
        self.team = team
        limits = [team.limits(agent) for agent in team.agents]
        low = np.concatenate([np.ravel(least) for least, _ in limits])
        high = np.concatenate([np.ravel(most) for _, most in limits])
        if len(team.agents) > 1:
            flags = len(team.agents)
            low = np.concatenate([np.minimum(low, 0.0), np.zeros(flags)])
            high = np.concatenate([np.maximum(high, 0.0), np.ones(flags)])
        self._limits = low, high
        self.failure_reward = team.failure_reward
        super().__init__(
            team.system,
            actions=[c for agent in team.agents for c in team.actions[agent]],
            observations=(),
            action_step=team.action_step,
            horizon=team.horizon,
            signals=team.signals,
            randomisation=team.randomisation,
        )

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return the start values of the team's task for the episodes of `draws`."""
        return self.team.start(draws)

    @property
    def extra_limits(self) -> tuple[Sequence[float], Sequence[float]]:
        """The lower and upper limits of the observations, two sequences of their width."""
        low, high = self._limits
        return low.tolist(), high.tolist()

    def extra(self, m: Moment) -> Array:
        """Return the observations of all agents, of shape (n, width)."""
        seen = self.team.observe(self._split(m))
        parts = [np.asarray(seen[agent], float) for agent in self.team.agents]
        if len(parts) > 1:
            here = self._present(m)
            parts = [np.where(here[:, j, None], p, 0.0) for j, p in enumerate(parts)]
            parts.append(here.astype(float))
        return np.concatenate(parts, axis=1)

    def reward(self, m: Moment) -> Array:
        """Return the sum of the rewards of the present agents, or the team's, of shape (n,)."""
        given = self.team.reward(self._split(m))
        rewards = np.stack([given[agent] for agent in self.team.agents], axis=1)
        here = self._present(m)
        total = np.asarray(np.where(here, rewards, 0.0).sum(axis=1))
        shared = bool(getattr(self.team, "team_reward", False))
        return total / np.maximum(here.sum(axis=1), 1) if shared else total

    def terminated(self, m: Moment) -> Mask:
        """Return in which environments a present agent has terminated, of shape (n,)."""
        given = self.team.terminated(self._split(m))
        ended = np.stack([given[agent] for agent in self.team.agents], axis=1)
        return np.asarray((ended & self._present(m)).any(axis=1))

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return the infos of the team's task, of shape (n, …)."""
        return self.team.info(self._split(m))

    def expressions(self, m: Symbols) -> Mapping[str, Any] | None:
        """Return the expressions of the team's task, or None if it has none of its own."""
        import casadi as ca

        team, agents = self.team, self.team.agents
        needed = {"observe", "reward", "terminated", "info"}
        if type(team).present is not TeamTask.present or needed - declared_methods(team):
            return None
        given = team.expressions(split_action(m, self._columns))
        if given is None or needed - set(given):
            return None
        flags = [ca.SX(1.0)] * len(agents) if len(agents) > 1 else []
        reward = given["reward"][agents[0]]
        ended = given["terminated"][agents[0]]
        for agent in agents[1:]:
            reward = reward + given["reward"][agent]
            ended = ca.logic_or(ended, given["terminated"][agent])
        if team.team_reward:
            reward = reward / len(agents)
        return {
            "extra": ca.vertcat(*(given["observe"][a] for a in agents), *flags),
            "reward": reward,
            "terminated": ended,
            "info": given["info"],
        }

    def view(self, m: Moment, row: int) -> View | None:
        """Return the picture of the team's task, of the environment of a `row`."""
        return self.team.view(self._split(m), row)

    def _present(self, m: Moment) -> Mask:
        given = self.team.present(self._split(m))
        return np.stack([given[agent] for agent in self.team.agents], axis=1)

    def _split(self, m: Moment) -> Moment:
        return _TeamMoment(m, self._columns)

    @cached_property
    def _columns(self) -> Mapping[str, slice]:
        """The slice of the action for each agent."""
        plan = flatten(self.team.system)
        widths = [ActionBox(plan, self.team.actions[a]).width for a in self.team.agents]
        ends = np.cumsum([0, *widths]).tolist()
        return {a: slice(i, j) for a, (i, j) in zip(self.team.agents, pairwise(ends), strict=True)}


@final
class _TeamMoment:
    """A moment whose actions are split by agent of the team."""

    def __init__(self, m: Moment, columns: Mapping[str, slice]) -> None:
        self._m, self._columns = m, columns

    @property
    def n(self) -> int:
        return self._m.n

    @property
    def time(self) -> Array:
        return self._m.time

    @property
    def step(self) -> NDArray[np.int64]:
        return self._m.step

    @property
    def action(self) -> Mapping[str, Array]:
        (whole,) = self._m.action.values()
        return {agent: whole[:, columns] for agent, columns in self._columns.items()}

    @property
    def before(self) -> Moment:
        before = self._m.before
        return self if before is self._m else _TeamMoment(before, self._columns)

    @property
    def start(self) -> Mapping[str, Array]:
        return self._m.start

    def __getitem__(self, name: str) -> Array:
        return self._m[name]
