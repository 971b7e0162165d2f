"""Rollout: episodes of a task in n environments as arrays; the state can be saved and restored.

Tasks of one agent and of a team have the same form: observations (n, N, d), actions (n, N, a).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.envs.episodes.episodes import AGENT, Episodes
from uuvsim_cosim.envs.episodes.multi_agent import TeamSimulation
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.episodes.spaces import ActionBox
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.policies.policy import Named, names_of

if TYPE_CHECKING:
    from uuvsim_cosim.learn.algorithms.checkpoint import State

__all__ = ["Ended", "Rollout"]

Array = NDArray[np.float32]
Mask = NDArray[np.bool_]
# Rewards (n, N), agents that terminated (n, N), episodes that are over (n,), and the task's infos.
Outcome = tuple[NDArray[np.float64], Mask, Mask, Mapping[str, NDArray[np.generic]]]


@dataclass(frozen=True)
class Ended:
    """Episodes that have just ended: returns (of a team, the mean over its agents) and metrics.

    `metrics` are means of the task's infos over the second half of each episode, as those of
    `envs.tasks.evaluate`.
    """

    returns: NDArray[np.float64]  # (k,)
    steps: NDArray[np.int64]  # (k,)
    metrics: Mapping[str, NDArray[np.float64]]


@final
class Rollout:
    """Parallel episodes in n environments; if one ends, the next begins in the same step.

    Environment i has the seed `seed` + i. The whole state consists of the seeds, the numbers of the
    episodes, and the actions since their starts, because an episode depends on nothing else.
    """

    def __init__(self, task: Task | TeamTask, n: int, seed: int, *, threads: int = 1) -> None:
        self.task, self.n = task, n
        self._world: _Alone | _Team
        self._world = (_Team if isinstance(task, TeamTask) else _Alone)(task, n, threads)  # type: ignore[arg-type]
        self.agents = self._world.agents
        self._length = int(task.horizon / task.action_step)
        self.observation = self._world.reset([seed + i for i in range(n)])
        self.acted = self._world.acted
        shape = (self._length, n, len(self.agents), self.acted)
        self._actions = np.zeros(shape, np.float32)  # since each row's reset
        self._returns = np.zeros((self._length, n))
        self._infos: dict[str, NDArray[np.float64]] = {}

    @property
    def observed(self) -> int:
        """The width of an observation."""
        return int(self.observation.shape[2])

    @property
    def steps(self) -> NDArray[np.int64]:
        """The number of actions since the resets, of shape (n,)."""
        return self._world.episodes.moment.step

    def named(self) -> tuple[tuple[Named, ...], tuple[Named, ...]]:
        """Return names and limits of the first agent's observation and action."""
        return self._world.named()

    def step(self, actions: Array) -> tuple[Transitions, Ended | None]:
        """Make one step with `actions` (n, N, a) in [-1, 1].

        Returns the transitions, and the episodes that have ended, or None.
        """
        actions = np.asarray(actions, np.float32)
        before, at = self.observation, self.steps.copy()
        self._actions[at, np.arange(self.n)] = actions
        reward, terminated, over, infos = self._world.act(actions)
        after = self.observation = self._world.observe()
        self._keep(at, reward, infos)
        ended = None
        if over.any():
            rows = np.flatnonzero(over)
            length = at[rows] + 1
            counted = np.arange(self._length)[:, None] < length
            # Means over the second half: step k (from 0) counts where 2 k >= length - 1.
            late = counted & (2 * np.arange(self._length)[:, None] >= length - 1)
            ended = Ended(
                np.where(counted, self._returns[:, rows], 0.0).sum(axis=0),
                length,
                {
                    name: np.where(late, kept[:, rows], 0.0).sum(axis=0) / late.sum(axis=0)
                    for name, kept in self._infos.items()
                },
            )
            self._world.again(over)
            self.observation = self._world.observe()
        transitions = Transitions(before, actions, reward.astype(np.float32), after,
                            terminated.astype(np.float32))  # fmt: skip
        return transitions, ended

    def _keep(
        self, at: NDArray[np.int64], reward: NDArray[np.float64],
        infos: Mapping[str, NDArray[np.generic]],
    ) -> None:  # fmt: skip
        """Store the rewards and infos of the steps `at` (n,), for the means of the episodes."""
        rows = np.arange(self.n)
        self._returns[at, rows] = reward.mean(axis=1)
        for name, values in infos.items():
            if np.shape(values) == (self.n,):
                kept = self._infos.setdefault(name, np.zeros((self._length, self.n)))
                kept[at, rows] = values

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Return the seeds and the actions from which `set_state` repeats the episodes."""
        episodes = self._world.episodes
        return {
            "seeds": episodes.seeds.copy(),
            "episodes": episodes.episodes.copy(),
            "steps": self.steps.copy(),
            "actions": self._actions[: int(self.steps.max(initial=0))].copy(),
        }

    def set_state(self, state: State) -> None:
        """Restore a state: repeat its episodes with their actions up to the same step."""
        steps = np.asarray(state["steps"])
        if steps.shape != (self.n,) or state["actions"].shape[1:] != self._actions.shape[1:]:
            raise InputInvalid(
                f"{len(steps)} environments, actions of shape {state['actions'].shape[2:]}",
                f"{self.n} and {self._actions.shape[2:]}",
            )
        most = int(steps.max(initial=0))
        self._actions[:most] = state["actions"]
        episodes = self._world.episodes
        episodes.count(np.asarray(state["seeds"]), np.asarray(state["episodes"]) - 1)
        self._world.again(np.ones(self.n, bool))
        for k in range(most):
            # Environments with fewer steps begin later: their actions until then do not matter.
            late = steps == most - k
            if k and late.any():
                episodes.count(episodes.seeds, episodes.episodes - late)
                self._world.again(late)
            at = self.steps
            reward, _, _, infos = self._world.act(self._actions[at, np.arange(self.n)])
            self._keep(at, reward, infos)
        fresh = steps == 0
        if most and fresh.any():
            episodes.count(episodes.seeds, episodes.episodes - fresh)
            self._world.again(fresh)
        self.observation = self._world.observe()

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        self._world.episodes.close()


class _Team:
    def __init__(self, task: TeamTask, n: int, threads: int) -> None:
        self._stage = TeamSimulation(task, n, threads=threads)
        self.agents = self._stage.agents
        self.episodes: Episodes = self._stage.episodes
        boxes = {self._stage.boxes[a].width for a in self.agents}
        if len(boxes) > 1 or len({self._stage.spaces[a].shape for a in self.agents}) > 1:
            raise InputInvalid(self._stage.place, "agents with different widths", "equal ones")
        (self.acted,) = boxes

    def reset(self, seeds: list[int]) -> Array:
        self._stage.reset(seeds=seeds)
        return self.observe()

    def again(self, rows: NDArray[np.bool_]) -> None:
        self._stage.reset(rows)

    def observe(self) -> Array:
        team = self._stage.now
        every = np.stack([team.observation[a] for a in self.agents], axis=1)
        return np.where(team.seen[:, :, None], every, np.float32(0))

    def act(self, actions: Array) -> Outcome:
        team = self._stage.act({a: actions[:, j] for j, a in enumerate(self.agents)})
        return team.reward, team.terminated, team.over, self._stage.info(team.moment)

    def named(self) -> tuple[tuple[Named, ...], tuple[Named, ...]]:
        agent = self.agents[0]
        space = self._stage.spaces[agent]
        return _named(space.low, space.high, self._stage.boxes[agent], agent)


class _Alone:
    def __init__(self, task: Task, n: int, threads: int) -> None:
        self._stage = TaskSimulation(task, n, threads=threads)
        self.agents = (AGENT,)
        self.episodes: Episodes = self._stage.episodes
        self.acted = self._stage.action_box.width

    def reset(self, seeds: list[int]) -> Array:
        self.episodes.reset(seeds=seeds)
        return self.observe()

    def again(self, rows: NDArray[np.bool_]) -> None:
        self.episodes.reset(rows)

    def observe(self) -> Array:
        return self._stage.observe(self.episodes.moment)[:, None]

    def act(self, actions: Array) -> Outcome:
        m = self._stage.act(actions[:, 0])
        terminated = self._stage.terminated(m)
        over = terminated | self.episodes.over
        return self._stage.reward(m)[:, None], terminated[:, None], over, self._stage.info(m)

    def named(self) -> tuple[tuple[Named, ...], tuple[Named, ...]]:
        seen = self._stage.observation_box
        return _named(seen.low, seen.high, self._stage.action_box, "")


def _named(
    low: ArrayLike, high: ArrayLike, box: ActionBox, agent: str
) -> tuple[tuple[Named, ...], tuple[Named, ...]]:
    acts = [box.name(i).removeprefix(f"{agent}." if agent else "") for i in range(box.width)]
    return names_of(np.asarray(low), np.asarray(high)), tuple(
        Named(name, -1.0, 1.0) for name in acts
    )
