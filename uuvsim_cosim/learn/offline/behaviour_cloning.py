"""Behaviour cloning: imitation of the actions in a dataset, L = mean of |pi(s) - a|²."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import torch

from uuvsim_cosim.learn.algorithms.gradients import descend
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP
from uuvsim_cosim.learn.data.dataset import Dataset
from uuvsim_cosim.learn.offline.offline_parts import OfflineSettings, Rows, policy_of
from uuvsim_cosim.learn.policies.policy import Policy

__all__ = ["BcSettings", "BehaviourCloning"]


@dataclass(frozen=True)
class BcSettings(OfflineSettings):
    """Settings of behaviour cloning."""

    hidden: int = 256  # width of each hidden layer


@final
class BehaviourCloning:
    """Behaviour cloning on a dataset; `update` is one step of Adam."""

    name = "bc"

    def __init__(self, data: Dataset, settings: BcSettings, seed: int) -> None:
        self.data, self.settings, self._rows = data, settings, Rows(data, seed)
        widths = [len(data.observation), settings.hidden, settings.hidden, len(data.action)]
        self.actor = StackedMLP(1, widths, torch.Generator().manual_seed(seed))
        self._adam = torch.optim.Adam(self.actor.parameters(), lr=settings.lr)

    def update(self) -> dict[str, float]:
        """Make one update with sampled transitions; return the loss."""
        o, a, *_ = self._rows.draw(self.settings.batch)
        loss = ((torch.tanh(self.actor(o[None])[0]) - a) ** 2).mean()
        return {"loss": descend("bc", "loss", self._adam, loss)}

    def policy(self) -> Policy:
        """Return the policy learned so far."""
        own = {"shift": self._rows.shift, "scale": self._rows.scale}
        return policy_of(self.data, "tanh", {**self.actor.tensors(0), **own}, {})
