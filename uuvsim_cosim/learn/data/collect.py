"""Collection of a dataset: episode 0 of consecutive seeds, in which a policy acts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.envs.tasks import scripted
from uuvsim_cosim.envs.tasks.scripted import scripted_policy
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.data.dataset import Dataset, Episode
from uuvsim_cosim.learn.policies.policy import Named, Policy, begin
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.agents import agents_of
from uuvsim_cosim.learn.training.loading import acting_in, load_policies, random_policy
from uuvsim_cosim.learn.training.rollout import Rollout

if TYPE_CHECKING:
    from uuvsim_cosim.cluster.ray_cluster import Cluster

__all__ = ["COLLECTING_SEED", "WORDS", "collect"]

COLLECTING_SEED = 3_000_000  # apart from those of trainings, evaluations and judgements
WORDS = ("scripted", "random", "mixed")
AT_ONCE = 256  # environments
SPREAD = 0.5  # deviation of what "mixed" adds to a third of its episodes

Array = NDArray[np.float32]
Act = Callable[[Array, NDArray[np.intp]], Array]  # observations (n, N, d), episodes (n,)


def collect(
    name: str,
    policy: str | Path = "scripted",
    episodes: int = 100,
    *,
    options: Mapping[str, object] | None = None,
    seed: int = COLLECTING_SEED,
    cluster: Cluster | None = None,
) -> Dataset:
    """Collect a dataset: let a policy act in episodes of a task; return what it observed and did.

    `name` is the name of a task and `options` are its options, as in `make_task`. `policy` is
    "scripted", "random", the file of a policy, the folder of a training, or "mixed", which
    alternates from episode to episode between the scripted controller, the scripted controller with
    noise of standard deviation 0.5 on each action, and random actions. The episodes have the seeds
    `seed`, `seed` + 1, …. With a `cluster`, its workers collect the same bits.

    The result has `episodes`, each with observations (T + 1, width), actions (T, width) in [-1, 1]
    and rewards (T,); of a team, each agent has episodes of its own. `returns` are their sums of
    rewards. Raises InputInvalid for less than 1 or more than 100,000 episodes, and for an unknown
    task or policy.

    Example:

    >>> from uuvsim_cosim.learn import collect
    >>> data = collect("source", "scripted", episodes=4)
    >>> len(data.episodes), data.steps, data.episodes[0].action.shape  # 50 actions of 0.4 s each
    (4, 200, (50, 2))
    >>> data.returns.round(1)
    array([ 97. ,  96.4,  96.8, 101.7])
    """
    if not 1 <= episodes <= 100_000:
        raise InputInvalid(f"{episodes} episodes", "1 … 100000")
    word = policy if policy in WORDS else None
    acts = str(word) if word else tuple(load_policies(policy))
    parts = [
        _Part(name, dict(options or {}), acts, seed, first, min(AT_ONCE, episodes - first))
        for first in range(0, episodes, AT_ONCE)
    ]
    came = cluster.spread(_collect, parts) if cluster else enumerate(map(_collect, parts))
    found = dict(came)
    kept = [episode for k in range(len(parts)) for episode in found[k][0]]
    told = {"policy": word or Path(policy).name, "seed": seed}
    return Dataset(kept, *found[0][1], name, dict(options or {}), told)


# ---- inside -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Part:
    """`count` episodes side by side; their data depend on nothing else."""

    name: str
    options: Mapping[str, object]
    acts: str | tuple[Policy, ...]
    seed: int
    first: int
    count: int


_Collected = tuple[list[Episode], tuple[tuple[Named, ...], tuple[Named, ...]]]


def _collect(part: _Part) -> _Collected:
    """Return the episodes of all environments, and of all agents, in their order."""
    task = make_task(part.name, part.options)
    acts, parts = _acts(task, part)
    for one in parts:
        begin(one)
    rollout = Rollout(task, part.count, part.seed + part.first)
    numbers = np.arange(part.first, part.first + part.count)
    transitions, alive = [], np.ones(part.count, bool)
    steps = np.zeros((part.count, len(rollout.agents)), int)
    ended = np.zeros(steps.shape, bool)
    try:
        while alive.any():
            t, _ = rollout.step(acts(rollout.observation, numbers))
            transitions.append(t)
            steps += alive[:, None] & ~ended
            ended |= alive[:, None] & (t.terminated > 0)
            alive &= rollout.steps > 0
        named = rollout.named()
    finally:
        rollout.close()
    o, a, r, after = (
        np.stack([getattr(t, k) for t in transitions])
        for k in ("observation", "action", "reward", "after")
    )
    episodes = [
        Episode(
            np.concatenate([o[:k, i, j], after[k - 1 : k, i, j]]),
            a[:k, i, j],
            r[:k, i, j],
            bool(ended[i, j]),
        )
        for i in range(part.count)
        for j, k in enumerate(steps[i])
    ]
    return episodes, named


def _acts(task: Task | TeamTask, part: _Part) -> tuple[Act, list[scripted.Policy]]:
    """Return how all agents act, and the policies that it is made of."""
    policy = part.acts
    drawn = part.seed if part.first == 0 else [part.seed, part.first]
    random = np.random.default_rng(drawn)
    given: scripted.Policies
    if policy in ("scripted", "mixed"):
        given = scripted_policy(task)
    elif policy == "random":
        given = random_policy(task, drawn)
    else:
        given = acting_in(task, [p for p in policy if isinstance(p, Policy)], part.name)
    parts = [given[a] for a in agents_of(task)] if isinstance(given, Mapping) else [given]

    def act(observation: Array, numbers: NDArray[np.intp]) -> Array:
        columns = [p(observation[:, j]) for j, p in enumerate(parts)]
        action = np.stack(columns, axis=1).astype(np.float32)
        if policy == "mixed":
            spread = action + SPREAD * random.standard_normal(action.shape)
            even = random.uniform(-1.0, 1.0, action.shape)
            third = (numbers % 3)[:, None, None]
            action = np.select([third == 0, third == 1], [action, spread], even)
        return np.clip(action, -1.0, 1.0).astype(np.float32)

    return act, parts
