"""Implicit Q-learning: values of the actions in a dataset, and cloning of the better ones.

Kostrikov et al., 2021. With the expectile loss L_tau(u) = |tau - (u < 0)| u²:

    V:   L_tau(min_k Q_k^-(s, a) - V(s))
    Q_k: (r + gamma (1 - terminated) V(s') - Q_k(s, a))²
    pi:  exp(beta (min_k Q_k^-(s, a) - V(s))) |pi(s) - a|²,  the exponential limited to 100

Advantages are divided by their mean size in the batch, so that beta does not depend on the unit of
the rewards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import torch

from uuvsim_cosim.learn.algorithms.gradients import descend
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP
from uuvsim_cosim.learn.data.dataset import Dataset
from uuvsim_cosim.learn.offline.offline_parts import OfflineSettings, Rows, policy_of
from uuvsim_cosim.learn.policies.policy import Policy

__all__ = ["Iql", "IqlSettings"]


@dataclass(frozen=True)
class IqlSettings(OfflineSettings):
    """Settings of implicit Q-learning."""

    hidden: int = 256  # width of each hidden layer
    gamma: float = 0.99  # discount factor
    tau: float = 0.01  # soft update of the target networks
    expectile: float = 0.7  # of the loss of V
    beta: float = 3.0  # inverse temperature of the weights of cloning


@final
class Iql:
    """Implicit Q-learning on a dataset; `update` is one step of Adam for each network."""

    name = "iql"

    def __init__(self, data: Dataset, settings: IqlSettings, seed: int) -> None:
        self.data, self.settings, self._rows = data, settings, Rows(data, seed)
        seen, acts, h = len(data.observation), len(data.action), settings.hidden
        random = torch.Generator().manual_seed(seed)
        self.actor = StackedMLP(1, [seen, h, h, acts], random)
        self.value = StackedMLP(1, [seen, h, h, 1], random)
        self.critic = StackedMLP(2, [seen + acts, h, h, 1], random)
        self.target = StackedMLP(2, [seen + acts, h, h, 1], random)
        self.target.load_state_dict(self.critic.state_dict())
        self.target.requires_grad_(False)
        self._adam = {
            name: torch.optim.Adam(net.parameters(), lr=settings.lr)
            for name, net in (("actor", self.actor), ("value", self.value), ("critic", self.critic))
        }

    def update(self) -> dict[str, float]:
        """Make one update with sampled transitions; return the losses."""
        s = self.settings
        o, a, r, after, ended = self._rows.draw(s.batch)
        both = torch.cat([o, a], 1).expand(2, -1, -1)
        with torch.no_grad():
            q = self.target(both).amin(0)[:, 0]
            y = r + s.gamma * (1.0 - ended) * self.value(after[None])[0, :, 0]
        v = self.value(o[None])[0, :, 0]
        u = q - v
        weight = torch.where(u.detach() < 0, 1.0 - s.expectile, s.expectile)
        losses = {
            "value_loss": descend("iql", "value_loss", self._adam["value"], (weight * u**2).mean())
        }
        loss = ((self.critic(both)[..., 0] - y) ** 2).mean(1).sum()
        losses["critic_loss"] = descend("iql", "critic_loss", self._adam["critic"], loss)
        advantage = u.detach() / u.detach().abs().mean().clamp(min=1e-6)
        how_much = (s.beta * advantage).exp().clamp(max=100.0)
        error = ((torch.tanh(self.actor(o[None])[0]) - a) ** 2).sum(1)
        losses["actor_loss"] = descend(
            "iql", "actor_loss", self._adam["actor"], (how_much * error).mean()
        )
        with torch.no_grad():
            for slow, fast in zip(self.target.parameters(), self.critic.parameters(), strict=True):
                slow.lerp_(fast, s.tau)
        return losses

    def policy(self) -> Policy:
        """Return the policy learned so far."""
        own = {"shift": self._rows.shift, "scale": self._rows.scale}
        return policy_of(self.data, "tanh", {**self.actor.tensors(0), **own}, {})
