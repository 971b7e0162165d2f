"""Evaluation of a policy: its episodes on given seeds, side by side, and the task's metrics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.multi_agent import TeamStage
from uuvsim_cosim.envs.episodes.single_agent import Stage
from uuvsim_cosim.envs.plants.choice import Backend
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.envs.tasks.scripted import Policies, Policy
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Evaluation", "evaluate"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Evaluation:
    """Results of n episodes; `metrics` are means over the second half of each, of shape (n,)."""

    returns: Array  # (n,); of a team, the mean of its agents
    seconds: Array  # (n,), how long each lasted
    metrics: Mapping[str, Array]

    def summary(self) -> dict[str, float]:
        """Return means over the episodes; of tracking, also `clean` and `success` as shares.

        `clean` is the share of episodes without a penalty, `success` of those with track >= 0.9.
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
    """Run episode 0 of the seeds `seed`, `seed` + 1, …, each to its end.

    `policy` maps observations (n, width) to actions (n, width); a team has one for each agent. The
    metrics are the numbers of the task's `info`.
    """
    if episodes < 1:
        raise InputInvalid(f"{episodes} episodes", "at least 1")
    stage: _Single | _Team
    if isinstance(task, TeamTask):
        if not isinstance(policy, Mapping) or set(policy) != set(task.agents):
            raise InputInvalid(f"expected a policy for each of {', '.join(task.agents)}")
        stage = _Team(TeamStage(task, episodes, backend=backend, threads=threads), policy)
    else:
        if isinstance(policy, Mapping):
            raise InputInvalid("policies by agent for a task of one", "one policy")
        stage = _Single(Stage(task, episodes, backend=backend, threads=threads), policy)
    for one in policy.values() if isinstance(policy, Mapping) else (policy,):
        if (begin := getattr(one, "begin", None)) is not None:
            begin()  # a policy with a memory
    try:
        return _run(task, stage, [seed + i for i in range(episodes)])
    finally:
        stage.stage.episodes.close()


def _run(task: Task | TeamTask, stage: _Single | _Team, seeds: list[int]) -> Evaluation:
    n, steps = len(seeds), int(task.horizon / task.action_step)
    stage.reset(seeds)
    returns, alive, length = np.zeros(n), np.ones(n, bool), np.zeros(n, int)
    rows: list[tuple[Mask, Mapping[str, NDArray[np.generic]]]] = []
    for _ in range(steps):
        reward, ended, info = stage.step()
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


class _Single:
    def __init__(self, stage: Stage, policy: Policy) -> None:
        self.stage, self.policy = stage, policy

    def reset(self, seeds: list[int]) -> None:
        self.m = self.stage.episodes.reset(seeds=seeds)

    def step(self) -> tuple[Array, Mask, Mapping[str, NDArray[np.generic]]]:
        stage = self.stage
        self.m = m = stage.act(self.policy(stage.observe(self.m)))
        return stage.reward(m), stage.terminated(m) | stage.episodes.over, stage.info(m)


class _Team:
    def __init__(self, stage: TeamStage, policies: Mapping[str, Policy]) -> None:
        self.stage, self.policies = stage, policies

    def reset(self, seeds: list[int]) -> None:
        self.m = self.stage.reset(seeds=seeds)

    def step(self) -> tuple[Array, Mask, Mapping[str, NDArray[np.generic]]]:
        acts = {agent: act(self.m.observation[agent]) for agent, act in self.policies.items()}
        self.m = m = self.stage.act(acts)
        count = np.maximum(m.acted.sum(axis=1), 1)
        return m.reward.sum(axis=1) / count, m.over, self.stage.task.info(m.moment)
