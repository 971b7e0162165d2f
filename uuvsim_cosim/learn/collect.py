"""What a policy lives becomes a dataset: episode 0 of consecutive seeds, side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task import Task, TeamTask
from uuvsim_cosim.envs.tasks.scripted import scripted_policy
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.dataset import Dataset, Episode
from uuvsim_cosim.learn.loading import acting_in, load_policies, random_policy
from uuvsim_cosim.learn.policy import Named
from uuvsim_cosim.learn.rollout import Rollout
from uuvsim_cosim.learn.sequence_runner import begin
from uuvsim_cosim.learn.task_ids import make_task

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
    options: Mapping[str, Any] | None = None,
    seed: int = COLLECTING_SEED,
) -> Dataset:
    """Let a policy act in a task's episodes; what it sees, does and is given is kept.

    `policy` is "scripted", "random", a policy's file or a training's folder, or "mixed": episode
    by episode in turn scripted, scripted with noise, and random. Raises InputInvalid.
    """
    if not 1 <= episodes <= 100_000:
        raise InputInvalid(f"{episodes} episodes; expected 1 … 100000")
    task = make_task(name, options)
    acts, parts = _acts(task, name, policy, seed)
    kept: list[Episode] = []
    named: tuple[tuple[Named, ...], tuple[Named, ...]] = (), ()
    for first in range(0, episodes, AT_ONCE):
        rows = np.arange(first, min(first + AT_ONCE, episodes))
        for part in parts:
            begin(part)
        rollout = Rollout(task, len(rows), seed + first)
        try:
            named = rollout.named()
            kept += _lived(rollout, acts, rows)
        finally:
            rollout.close()
    told = {"policy": Path(policy).name if str(policy) not in WORDS else str(policy), "seed": seed}
    return Dataset(kept, named[0], named[1], name, dict(options or {}), told)


def _lived(rollout: Rollout, acts: Act, numbers: NDArray[np.intp]) -> list[Episode]:
    """Give the episodes of all environments, and of all agents, in their order."""
    n, agents = rollout.n, len(rollout.agents)
    lived, alive = [], np.ones(n, bool)
    steps = np.zeros((n, agents), int)
    ended = np.zeros((n, agents), bool)
    while alive.any():
        t, _ = rollout.step(acts(rollout.observation, numbers))
        lived.append(t)
        steps += alive[:, None] & ~ended
        ended |= alive[:, None] & (t.terminated > 0)
        alive &= rollout.steps > 0
    o, a, r, after = (
        np.stack([getattr(t, k) for t in lived])
        for k in ("observation", "action", "reward", "after")
    )
    return [
        Episode(
            np.concatenate([o[:k, i, j], after[k - 1 : k, i, j]]),
            a[:k, i, j],
            r[:k, i, j],
            bool(ended[i, j]),
        )
        for i in range(n)
        for j, k in enumerate(steps[i])
    ]


def _acts(task: Task | TeamTask, name: str, policy: str | Path, seed: int) -> tuple[Act, list[Any]]:
    """Give how all agents act, and the policies that it is made of."""
    random = np.random.default_rng(seed)
    given: Any
    if policy in ("scripted", "mixed"):
        given = scripted_policy(task)
    elif policy == "random":
        given = random_policy(task, seed)
    else:
        given = acting_in(task, load_policies(policy), name)
    parts = [given[a] for a in task.agents] if isinstance(task, TeamTask) else [given]

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
