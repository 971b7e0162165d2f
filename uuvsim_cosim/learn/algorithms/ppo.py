"""Proximal policy optimisation of N agents: independent (ppo for one, ippo) or central (mappo).

Schulman et al., "Proximal Policy Optimization Algorithms", 2017, with generalised advantages
(Schulman et al., 2016). For each agent, over `length` steps of n environments:

    delta_t = r_t + gamma (1 - terminated_t) V(s'_t) - V(s_t)
    A_t     = delta_t + gamma lambda (1 - over_t) (1 - terminated_t) A_{t+1}
    L(pi)   = -min(rho A, clip(rho, 1 - epsilon, 1 + epsilon) A),   rho = pi(a|s) / pi_old(a|s)
    L(V)    = 1/2 (V - (A + V_old))²

s' is the last observation of an episode that ended, so that the value of that state is included if
the horizon truncated the episode. The advantages of an agent that ends before its team do not
include rewards after its end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Self, final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import State, unfit
from uuvsim_cosim.learn.algorithms.gradients import check_gradients, clip_by_network
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP
from uuvsim_cosim.learn.algorithms.transfer import in_the_place_of, pass_on
from uuvsim_cosim.learn.shared.errors import LearningDiverged

__all__ = ["PpoLearner", "PpoSettings"]

Array = NDArray[np.float32]


@dataclass(frozen=True)
class PpoSettings:
    """Settings of PPO; those that the UUVSim paper names have the same values as for MASAC."""

    lr: float = 3e-4  # step size of Adam
    gamma: float = 0.99  # discount factor
    gae_lambda: float = 0.95  # lambda of generalised advantage estimation
    clip: float = 0.2  # clipping range of the probability ratio
    samples: int = 2048  # environment steps between updates, summed over all environments
    epochs: int = 10  # number of times that each sample is used
    batch: int = 256  # samples in one update
    entropy: float = 0.0  # weight of the entropy in the loss
    value: float = 0.5  # weight of the value error in the loss
    max_norm: float = 0.5  # greatest norm of each agent's gradient
    log_std: float = 0.0  # initial logarithm of the actions' standard deviation
    hidden: int = 256  # width of each hidden layer
    layers: int = 2  # number of hidden layers


@final
class PpoLearner:
    """PPO of N agents with equal widths; each has an actor and a critic in a stacked batch."""

    def __init__(
        self,
        agents: int,
        observed: int,
        acted: int,
        *,
        seed: int = 0,
        settings: PpoSettings | None = None,
        central: bool = False,
        name: str = "ippo",
    ) -> None:
        self.agents, self.observed, self.acted = agents, observed, acted
        self.given, self.central, self.name = settings or PpoSettings(), central, name
        s = self.given
        self._random = torch.Generator().manual_seed(seed)
        hidden = [s.hidden] * s.layers
        seen = agents * observed if central else observed
        self.actor = StackedMLP(agents, [observed, *hidden, acted], self._random)
        self.critic = StackedMLP(agents, [seen, *hidden, 1], self._random)
        with torch.no_grad():
            self.actor.weights[-1].mul_(0.01)  # the first mean actions are near 0: noise dominates
            self.actor.biases[-1].zero_()
        self.log_std = torch.full((agents, 1, acted), s.log_std, requires_grad=True)
        self._parameters = [*self.actor.parameters(), *self.critic.parameters(), self.log_std]
        self._optimizer = torch.optim.Adam(self._parameters, lr=s.lr, eps=1e-5)
        self._kept: list[dict[str, Array]] = []
        self._awake = np.zeros(observed, bool)  # observed numbers that have been nonzero
        self._drawn: tuple[Array, Array] | None = None  # unclipped actions, their log density

    @property
    def settings(self) -> Mapping[str, float]:
        """All settings by name."""
        return asdict(self.given)

    @torch.no_grad()
    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return actions (n, N, a) clipped to [-1, 1]: with `explore` drawn, else the means."""
        o = torch.as_tensor(observation, dtype=torch.float32).transpose(0, 1)
        action = self.actor(o)
        if explore:
            noise = torch.randn(action.shape, generator=self._random)
            action = action + self.log_std.exp() * noise
            log_pi = self._log_density(o, action)
            self._drawn = _rows(action), _rows(log_pi)
        return np.asarray(_rows(action).clip(-1.0, 1.0))

    def learn(self, transitions: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Store the transitions; after `samples` steps, learn from them and discard them."""
        if self._drawn is None:
            raise InputInvalid(self.name, "nothing was drawn", "act() before learn()")
        drawn, log_pi = self._drawn
        for seen in (transitions.observation, transitions.after):
            self._awake |= (seen != 0).any(axis=(0, 1))
        self._kept.append(
            {
                "observation": transitions.observation,
                "action": drawn,
                "log_pi": log_pi,
                "reward": transitions.reward,
                "after": transitions.after,
                "terminated": transitions.terminated,
                "over": np.repeat(over[:, None], self.agents, 1).astype(np.float32),
            }
        )
        if len(self._kept) * len(over) < self.given.samples:
            return {}
        columns = {
            k: torch.from_numpy(np.stack([row[k] for row in self._kept])) for k in self._kept[0]
        }
        self._kept = []
        return self._update(columns)

    def _update(self, kept: Mapping[str, Tensor]) -> dict[str, float]:
        """Learn from stored arrays (T, n, N, …); return the losses of the last gradient step."""
        s = self.given
        with torch.no_grad():
            v, v_after = (
                self._values(kept[k].flatten(0, 1)).view(kept[k].shape[:3])
                for k in ("observation", "after")
            )
            delta = kept["reward"] + s.gamma * (1.0 - kept["terminated"]) * v_after - v
            advantage, last = torch.zeros_like(delta), torch.zeros_like(delta[0])
            goes_on = (1.0 - kept["over"]) * (1.0 - kept["terminated"])
            for t in reversed(range(len(delta))):
                last = delta[t] + s.gamma * s.gae_lambda * goes_on[t] * last
                advantage[t] = last
        flat = {k: x.flatten(0, 1) for k, x in kept.items()} | {
            "advantage": advantage.flatten(0, 1),
            "goal": (advantage + v).flatten(0, 1),
        }
        count = len(flat["reward"])
        losses: dict[str, float] = {}
        for _ in range(s.epochs):
            order = torch.randperm(count, generator=self._random)
            for at in torch.split(order, s.batch):
                if len(at) > 1:
                    losses = self._descend({k: x[at] for k, x in flat.items()})
        return losses

    def _descend(self, b: Mapping[str, Tensor]) -> dict[str, float]:
        """Make one gradient step on a batch (m, N, …)."""
        s = self.given
        o, a = b["observation"].transpose(0, 1), b["action"].transpose(0, 1)
        A, log_old, goal = (b[k].T for k in ("advantage", "log_pi", "goal"))
        A = (A - A.mean(1, keepdim=True)) / (A.std(1, keepdim=True) + 1e-8)
        ratio = (self._log_density(o, a) - log_old).exp()
        kept = ratio.clamp(1.0 - s.clip, 1.0 + s.clip)
        actor_loss = -torch.minimum(ratio * A, kept * A).mean(1).sum()
        critic_loss = 0.5 * (self._values(b["observation"]).T - goal).square().mean(1).sum()
        entropy = (self.log_std + 0.5 * math.log(2.0 * math.pi * math.e)).sum(-1).sum()
        loss = actor_loss + 2.0 * s.value * critic_loss - s.entropy * entropy
        losses = {
            "actor_loss": float(actor_loss.detach()) / self.agents,
            "critic_loss": float(critic_loss.detach()) / self.agents,
            "entropy": float(entropy.detach()) / self.agents,
            "ratio": float(ratio.detach().mean()),
        }
        for name, value in losses.items():
            if not math.isfinite(value):
                raise LearningDiverged(self.name, name, value)
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        check_gradients(self.name, "actors and critics", self._parameters)
        clip_by_network(self._parameters, s.max_norm)
        self._optimizer.step()
        return losses

    def _log_density(self, o: Tensor, a: Tensor) -> Tensor:
        """Return the log density (N, m) of unclipped actions (N, m, a)."""
        z = (a - self.actor(o)) / self.log_std.exp()
        each: Tensor = -0.5 * z.square() - self.log_std - 0.5 * math.log(2.0 * math.pi)
        return each.sum(-1)

    def _values(self, o: Tensor) -> Tensor:
        """Return each agent's value (m, N) for the observations of all agents (m, N, d)."""
        seen = o.flatten(1).expand(self.agents, -1, -1) if self.central else o.transpose(0, 1)
        values: Tensor = self.critic(seen)
        return values.squeeze(-1).T

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return the kind "clip" and the tensors of an agent's mean action."""
        return "clip", self.actor.tensors(agent)

    def go_on_from(self, last: Self, seed: int) -> None:
        """Copy networks and standard deviations of `last`; raises InputInvalid for other shapes."""
        nets = [i % last.agents for i in range(self.agents)]
        own = [[(0, 0)]] * self.agents
        pass_on(last.actor, self.actor, nets, own, last._awake)
        every = [in_the_place_of(i, self.agents, was, last.agents) for i, was in enumerate(nets)]
        pass_on(last.critic, self.critic, nets, every if self.central else own, last._awake)
        with torch.no_grad():
            self.log_std.copy_(last.log_std[nets])

    def state(self) -> State:
        """Return networks, optimiser, stored transitions and random number generator."""
        kept = {k: np.stack([row[k] for row in self._kept]) for k in (self._kept or [{}])[0]}
        return {
            "actor": self.actor.state_dict(),
            "critic": self.critic.state_dict(),
            "log_std": self.log_std.detach().clone(),
            "adam": self._optimizer.state_dict(),
            "random": self._random.get_state(),
            "awake": self._awake.copy(),
            "kept": kept,
        }

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for another shape."""
        try:
            self.actor.load_state_dict(state["actor"])
            self.critic.load_state_dict(state["critic"])
            with torch.no_grad():
                self.log_std.copy_(state["log_std"])
            self._optimizer.load_state_dict(state["adam"])
            self._random.set_state(state["random"])
            awake = state.get("awake")  # older files lack it: any number may have been nonzero
            self._awake = np.ones(self.observed, bool) if awake is None else np.array(awake, bool)
            kept = state["kept"]
            count = len(kept["reward"]) if kept else 0
            self._kept = [{k: x[t] for k, x in kept.items()} for t in range(count)]
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise unfit(error) from error


def _rows(x: Tensor) -> Array:
    """Return a tensor (N, n, …) as an array (n, N, …)."""
    return np.asarray(x.transpose(0, 1).contiguous().numpy())
