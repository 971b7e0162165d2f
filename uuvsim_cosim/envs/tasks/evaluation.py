"""Evaluation of a policy: returns and metrics of its episodes on given seeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.multi_agent import TeamSimulation
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.plants.choice import Backend
from uuvsim_cosim.envs.task.task import Array, Mask, Task, TeamTask
from uuvsim_cosim.envs.tasks.scripted import Policies, Policy
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Evaluation", "evaluate"]

Outcome = tuple[Array, Mask, Mapping[str, NDArray[np.generic]]]  # rewards, ended, infos of a step


@dataclass(frozen=True)
class Evaluation:
    """Results of n episodes; `metrics` are means over the second half of each, of shape (n,)."""

    returns: Array  # (n,); of a team, the mean over its agents
    seconds: Array  # (n,), the durations
    metrics: Mapping[str, Array]

    def summary(self) -> dict[str, float]:
        """Return means over the episodes; for target tracking, also shares of episodes.

        `clean` is the share of episodes without a penalty, `success` the share with track >= 0.9.
        """
        means = {name: float(values.mean()) for name, values in self.metrics.items()}
        if {"track", "clean"} <= self.metrics.keys():
            means["clean"] = float(np.mean(self.metrics["clean"] == 1.0))
            means["success"] = float(np.mean(self.metrics["track"] >= 0.9))
        return {"return": float(self.returns.mean()), **means}


def evaluate(
    task: Task | TeamTask,
    policy: Policies,
    episodes: int = 100,
    *,
    seed: int = 1_000_000,
    threads: int = 1,
    backend: Backend = "auto",
) -> Evaluation:
    """Run `episodes` episodes in parallel, each to its end: episode 0 of `seed`, `seed` + 1, ….

    `policy` maps observations (n, width) to actions (n, width); for a team, it is a mapping with a
    policy for each agent. The metrics are the numbers of the task's `info`. `backend` and `threads`
    are those of `CosimVectorEnv`. Raises InputInvalid for less than one episode and for policies
    that do not match the agents.
    """
    if episodes < 1:
        raise InputInvalid(f"{episodes} episodes", "at least 1")
    seeds = [seed + i for i in range(episodes)]
    steps: Iterator[Outcome]
    if isinstance(task, TeamTask):
        if not isinstance(policy, Mapping) or set(policy) != set(task.agents):
            raise InputInvalid(f"expected a policy for each of {', '.join(task.agents)}")
        team = TeamSimulation(task, episodes, backend=backend, threads=threads)
        running, steps = team.episodes, _steps_of_team(team, policy, seeds)
    else:
        if isinstance(policy, Mapping):
            raise InputInvalid("policies by agent for a task of one", "one policy")
        alone = TaskSimulation(task, episodes, backend=backend, threads=threads)
        running, steps = alone.episodes, _steps_alone(alone, policy, seeds)
    for one in policy.values() if isinstance(policy, Mapping) else (policy,):
        if (begin := getattr(one, "begin", None)) is not None:
            begin()  # a policy with a memory
    n = episodes
    returns, alive, length = np.zeros(n), np.ones(n, bool), np.zeros(n, int)
    rows: list[tuple[Mask, Mapping[str, NDArray[np.generic]]]] = []
    with closing(running):
        for reward, ended, info in islice(steps, int(task.horizon / task.action_step)):
            returns += np.where(alive, reward, 0.0)
            length += alive
            numbers = {k: np.asarray(v, float) for k, v in info.items() if np.shape(v) == (n,)}
            rows.append((alive, numbers))
            alive = alive & ~ended
            if not alive.any():
                break
    metrics = {}
    for name in rows[0][1]:
        counted = np.stack([was & (2 * k >= length - 1) for k, (was, _) in enumerate(rows)])
        values = np.stack([numbers[name] for _, numbers in rows])
        metrics[name] = np.where(counted, values, 0.0).sum(axis=0) / counted.sum(axis=0)
    return Evaluation(returns, length * float(task.action_step), metrics)


def _steps_alone(
    simulation: TaskSimulation, policy: Policy, seeds: Sequence[int]
) -> Iterator[Outcome]:
    m = simulation.episodes.reset(seeds=seeds)
    while True:
        m = simulation.act(policy(simulation.observe(m)))
        ended = simulation.terminated(m) | simulation.episodes.over
        yield simulation.reward(m), ended, simulation.info(m)


def _steps_of_team(
    simulation: TeamSimulation, policies: Mapping[str, Policy], seeds: Sequence[int]
) -> Iterator[Outcome]:
    m = simulation.reset(seeds=seeds)
    while True:
        m = simulation.act({agent: act(m.observation[agent]) for agent, act in policies.items()})
        count = np.maximum(m.acted.sum(axis=1), 1)
        yield m.reward.sum(axis=1) / count, m.over, simulation.task.info(m.moment)
