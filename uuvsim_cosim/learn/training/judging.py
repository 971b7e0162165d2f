"""Judgement of policies on seeds used for nothing else: means with bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.envs.tasks.evaluation import Evaluation, evaluate
from uuvsim_cosim.envs.tasks.scripted import Policies, scripted_policy
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.statistics import Interval, interquartile_mean, interval
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED

__all__ = ["judge", "judge_scripted", "judged"]

DRAWS = 1000


def judge(
    task: Task | TeamTask,
    policies: Sequence[Policies],
    episodes: int = 100,
    seed: int = JUDGING_SEED,
) -> dict[str, Interval]:
    """Return figures of one policy, or of several together: each is run on the same episodes.

    "return" is the mean, "return iqm" the interquartile mean; the metrics are means over the
    second half of each episode, `clean` and `success` shares of episodes (see `Evaluation`).
    """
    return judged([evaluate(task, p, episodes, seed=seed) for p in policies])


def judge_scripted(
    task: Task | TeamTask, episodes: int = 100, seed: int = JUDGING_SEED
) -> dict[str, Interval]:
    """Return the figures of the task's scripted controller; none for a task without one."""
    try:
        policy = scripted_policy(task)
    except InputInvalid:
        return {}
    return judge(task, [policy], episodes, seed)


def judged(evaluations: Sequence[Evaluation]) -> dict[str, Interval]:
    """Return the figures of evaluations of one policy trained with several seeds."""

    def stacked(name: str) -> NDArray[np.float64]:
        return np.stack([e.metrics[name] for e in evaluations])

    returns = np.stack([e.returns for e in evaluations])
    values = {"return": returns}
    names = list(evaluations[0].metrics)
    values |= {name: stacked(name) for name in names}
    if {"track", "clean"} <= set(names):
        values["clean"] = (stacked("clean") == 1.0).astype(float)
        values["success"] = (stacked("track") >= 0.9).astype(float)
    found = {k: interval(v, lambda x: float(x.mean()), draws=DRAWS) for k, v in values.items()}
    iqm = {"return iqm": interval(returns, interquartile_mean, draws=DRAWS)}
    return {"return": found.pop("return"), **iqm, **found}
