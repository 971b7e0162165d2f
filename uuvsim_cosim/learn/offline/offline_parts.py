"""Common parts of learning from a dataset: normalisation, a gradient step, the policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uuvsim_cosim.learn.data.dataset import Dataset
from uuvsim_cosim.learn.policies.policy import Kind, Policy

__all__ = ["OfflineSettings", "Rows", "normalisation", "policy_of"]

Array = NDArray[np.float32]


@dataclass(frozen=True)
class OfflineSettings:
    """Settings of all algorithms that learn from a dataset."""

    lr: float = 1e-3  # learning rate
    batch: int = 256  # transitions, or sequences of K steps, in one update
    steps: int = 3000  # updates


class Rows:
    """Transitions of a dataset as normalised tensors, which are sampled uniformly."""

    def __init__(self, data: Dataset, seed: int) -> None:
        every = data.stacked()
        lived = every.lived
        self.shift, self.scale = normalisation(every.observation[:, :-1][lived])
        o, after = (
            (x[lived] - self.shift) * self.scale
            for x in (every.observation[:, :-1], every.observation[:, 1:])
        )
        last = np.arange(lived.shape[1]) == every.steps[:, None] - 1
        ended = (last & every.terminated[:, None])[lived]
        self._columns = [
            torch.from_numpy(np.ascontiguousarray(x, np.float32))
            for x in (o, every.action[lived], every.reward[lived], after, ended)
        ]
        self._random = torch.Generator().manual_seed(seed)

    def draw(self, n: int) -> list[Tensor]:
        """Draw n transitions: observations, actions, rewards, next observations, terminated."""
        at = torch.randint(len(self._columns[0]), (n,), generator=self._random)
        return [c[at] for c in self._columns]


def normalisation(rows: Array) -> tuple[Array, Array]:
    """Return shift and scale to mean 0 and deviation 1; the scale of a constant number is 1."""
    spread = rows.std(axis=0, dtype=np.float64)
    scale = np.where(spread > 1e-3, 1.0 / np.maximum(spread, 1e-3), 1.0)
    return rows.mean(axis=0, dtype=np.float64).astype(np.float32), scale.astype(np.float32)


def policy_of(
    data: Dataset, kind: Kind, tensors: Mapping[str, Array], settings: Mapping[str, object]
) -> Policy:
    """Return a policy for every agent of the dataset's task."""
    return Policy(kind, tensors, data.observation, data.action, data.task, options=data.options,
                  settings=settings)  # fmt: skip
