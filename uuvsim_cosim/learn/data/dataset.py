"""Dataset: episodes of observations, actions and rewards, and their task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policies.policy import Named

__all__ = ["Dataset", "Episode", "Stacked"]

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Episode:
    """T actions of one agent in [-1, 1], between T + 1 observations."""

    observation: Array  # (T + 1, d)
    action: Array  # (T, a)
    reward: Array  # (T,)
    terminated: bool  # ended by the task, not by the time limit


@dataclass(frozen=True)
class Stacked:
    """Episodes as rows of arrays, filled with zeros after their ends."""

    observation: Array  # (E, T + 1, d)
    action: Array  # (E, T, a)
    reward: Array  # (E, T)
    steps: NDArray[np.int64]  # (E,)
    terminated: NDArray[np.bool_]  # (E,)

    @property
    def lived(self) -> NDArray[np.bool_]:
        """The mask of the steps before the episodes' ends, of shape (E, T)."""
        return np.asarray(np.arange(self.action.shape[1]) < self.steps[:, None])


@dataclass(frozen=True)
class Dataset:
    """Episodes of a task; in a team, the data of each agent form a separate episode.

    `task` and `options` make the task; `task` is "" if it is unknown. `observation` and `action`
    name each number and its limits. `told` describes the origin of the episodes. Raises
    InputInvalid for episodes of other widths, for NaN, and for actions outside of [-1, 1].
    """

    episodes: Sequence[Episode]
    observation: tuple[Named, ...]
    action: tuple[Named, ...]
    task: str
    options: Mapping[str, object] = field(default_factory=dict)
    told: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        if not self.episodes:
            raise InputInvalid("dataset", "no episode", "at least one")
        seen, acts = len(self.observation), len(self.action)
        for i, e in enumerate(self.episodes):
            steps = len(e.action)
            shapes = (e.observation.shape, e.action.shape, e.reward.shape)
            wanted = ((steps + 1, seen), (steps, acts), (steps,))
            if shapes != wanted or not steps:
                raise InputInvalid(
                    f"dataset, episode {i}",
                    f"observations, actions and rewards of shapes {', '.join(map(str, shapes))}",
                    f"(T + 1, {seen}), (T, {acts}) and (T,), T at least 1",
                )
            for name in ("observation", "action", "reward"):
                if not np.all(np.isfinite(getattr(e, name))):
                    raise InputInvalid(
                        f"dataset, episode {i}", f"NaN or infinity in its {name}s", "numbers"
                    )
            if np.abs(e.action).max() > 1.0 + 1e-3:
                raise InputInvalid(
                    f"dataset, episode {i}",
                    f"an action of {np.abs(e.action).max():g}",
                    "actions in [-1, 1]",
                )

    @property
    def returns(self) -> NDArray[np.float64]:
        """Each episode's sum of rewards."""
        return np.array([float(e.reward.sum(dtype=np.float64)) for e in self.episodes])

    @property
    def steps(self) -> int:
        """The number of actions in all episodes."""
        return sum(len(e.action) for e in self.episodes)

    def stacked(self) -> Stacked:
        """Return all episodes as arrays."""
        steps = np.array([len(e.action) for e in self.episodes])
        n, most = len(steps), int(steps.max())
        o = np.zeros((n, most + 1, len(self.observation)), np.float32)
        a = np.zeros((n, most, len(self.action)), np.float32)
        r = np.zeros((n, most), np.float32)
        for i, e in enumerate(self.episodes):
            o[i, : steps[i] + 1], a[i, : steps[i]], r[i, : steps[i]] = (
                e.observation, e.action, e.reward,
            )  # fmt: skip
        ended = np.array([e.terminated for e in self.episodes])
        return Stacked(o, np.clip(a, -1.0, 1.0), r, steps, ended)
