"""Final judgement of policies on seeds of their own: means with bootstrap intervals.

Several policies are evaluated in parts, in this process or, with equal bits, on a cluster.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.envs.tasks.evaluation import Evaluation, evaluate
from uuvsim_cosim.envs.tasks.scripted import Policies, scripted_policy
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.statistics import Interval, interquartile_mean, interval
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED

if TYPE_CHECKING:
    from uuvsim_cosim.cluster.ray_cluster import Cluster

__all__ = ["AT_ONCE", "evaluate_all", "judge", "judge_scripted", "judged"]

DRAWS = 1000


def judge(
    task: Task | TeamTask,
    policies: Sequence[Policies],
    episodes: int = 100,
    seed: int = JUDGING_SEED,
) -> dict[str, Interval]:
    """Return the results of one policy, or of several together, on the same episodes.

    "return" is the mean return, "return iqm" the interquartile mean. The metrics are means over the
    second half of each episode; `clean` and `success` are shares of episodes (see `Evaluation`).
    """
    return judged([evaluate(task, p, episodes, seed=seed) for p in policies])


def judge_scripted(
    task: Task | TeamTask, episodes: int = 100, seed: int = JUDGING_SEED
) -> dict[str, Interval]:
    """Return the results of the task's scripted controller; {} for a task without one."""
    try:
        policy = scripted_policy(task)
    except InputInvalid:
        return {}
    return judge(task, [policy], episodes, seed)


def judged(evaluations: Sequence[Evaluation]) -> dict[str, Interval]:
    """Return the results of evaluations of a policy that was trained with several seeds."""

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


AT_ONCE = 256  # episodes side by side; fixed, as a matrix product's bits depend on its shape


_Part = tuple[str, Mapping[str, object], Policies, int, int]  # of task and policy, seed, episodes


def evaluate_all(
    name: str,
    options: Mapping[str, object],
    policies: Mapping[str, Policies],
    episodes: int,
    seed: int,
    *,
    cluster: Cluster | None = None,
    progress: Callable[[str, float, float], None] | None = None,
) -> dict[str, Evaluation]:
    """Evaluate each of `policies`, in the form that `evaluate` expects, on the same seeds.

    The episodes are distributed in parts, except those of "random", whose random numbers continue
    from episode to episode.
    """
    parts, owners = [], []
    for who, acts in policies.items():
        size = episodes if who == "random" else AT_ONCE
        for first in range(0, episodes, size):
            parts.append((name, options, acts, seed + first, min(size, episodes - first)))
            owners.append(who)
    came = cluster.spread(_evaluate, parts) if cluster else enumerate(map(_evaluate, parts))
    found: dict[int, Evaluation] = {}
    for k, evaluation in came:
        found[k] = evaluation
        if progress is not None:
            progress("evaluating", len(found), len(parts))
    joined = {}
    for who in policies:
        own = [found[k] for k in range(len(parts)) if owners[k] == who]
        joined[who] = Evaluation(
            np.concatenate([e.returns for e in own]),
            np.concatenate([e.seconds for e in own]),
            {k: np.concatenate([e.metrics[k] for e in own]) for k in own[0].metrics},
        )
    return joined


def _evaluate(part: _Part) -> Evaluation:
    name, options, acts, seed, episodes = part
    return evaluate(make_task(name, options), acts, episodes, seed=seed)
