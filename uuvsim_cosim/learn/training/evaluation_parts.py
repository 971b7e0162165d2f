"""Evaluation of several policies in parts, in this process or, with equal bits, on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.envs.tasks.evaluation import Evaluation, evaluate
from uuvsim_cosim.envs.tasks.scripted import Policies
from uuvsim_cosim.learn.shared.task_ids import make_task

if TYPE_CHECKING:
    from uuvsim_cosim.cluster.ray_cluster import Cluster

__all__ = ["AT_ONCE", "evaluate_all"]

AT_ONCE = 256  # episodes side by side; fixed, as a matrix product's bits depend on its shape


@dataclass(frozen=True)
class _Part:
    name: str
    options: Mapping[str, object]
    acts: Policies
    seed: int
    count: int


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
    """Return an Evaluation of each policy (as `evaluate` takes them); all on the same seeds.

    "random" is one part, since its random numbers continue from episode to episode.
    """
    parts, owners = [], []
    for who, acts in policies.items():
        size = episodes if who == "random" else AT_ONCE
        for first in range(0, episodes, size):
            parts.append(_Part(name, options, acts, seed + first, min(size, episodes - first)))
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
    return evaluate(make_task(part.name, part.options), part.acts, part.count, seed=part.seed)
