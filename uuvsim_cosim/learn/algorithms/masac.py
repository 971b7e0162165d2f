"""Multi-agent soft actor-critic: central critics, local actors; with one agent it is SAC.

The UUVSim paper's equations (9) to (12), with the minimum of two critics and the factor
(1 - terminated), which the paper leaves out. For agent i, with s and a of all agents and its own
observation s_i:

    (9)   L(Q_i) = 1/2 (Q_i(s, a) - y_i)²,  y_i = r_i + gamma (1 - terminated_i) V_i(s')
    (10)  V_i(s') = min_k Q_ik^-(s', a') - alpha_i log pi_i(a'_i | s'_i),    a' of all actors
    (11)  L(pi_i) = alpha_i log pi_i(a_i | s_i) - min_k Q_ik(s, a),          a_i of actor i alone
    (12)  L(alpha_i) = -alpha_i (log pi_i + H0),                             H0 = -dim a

The actors of all agents are one stacked batch of networks, and so are their critics, two each.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import softplus

from uuvsim_cosim.learn.algorithms.gradients import descend
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP

if TYPE_CHECKING:
    from uuvsim_cosim.learn.algorithms.checkpoint import State

__all__ = ["Masac", "MasacSettings"]

LOG_STD = -5.0, 2.0  # limits of the logarithm of an actor's deviation


@dataclass(frozen=True)
class MasacSettings:
    """Settings of SAC and MASAC; values are the paper's where it has them.

    docs/learning/learning.md describes the others.
    """

    lr: float = 3e-4  # step size of Adam
    gamma: float = 0.99  # discount factor
    tau: float = 0.01  # soft update of the target networks
    alpha: float = 0.2  # initial temperature
    tune_alpha: bool = True  # whether the temperature is tuned
    hidden: int = 256  # width of each hidden layer
    layers: int = 2  # number of hidden layers
    central: bool = True  # each critic sees all agents; False: independent SAC
    shared: bool = False  # one actor and one critic for all agents; each agent is its first input
    h0: float = 1.0  # the target entropy is -h0 dim a
    centre: float = 0.0  # rate at which the subtracted mean reward follows the critics' error
    normalised: bool = False  # layer normalisation in the critics, see `StackedMLP`
    # Weight of the current actor in the exponential moving average that is evaluated and exported.
    # With 1, the current actor itself is used.
    average: float = 1.0


@final
class Masac:
    """Networks of N agents, each of which observes `observed` numbers and acts by `acted`."""

    def __init__(
        self, agents: int, observed: int, acted: int, settings: MasacSettings, seed: int
    ) -> None:
        self.agents, self.observed, self.acted, self.settings = agents, observed, acted, settings
        self.random = torch.Generator().manual_seed(seed)
        hidden = [settings.hidden] * settings.layers
        seen = agents * (observed + acted) if settings.central else observed + acted
        self.nets = 1 if settings.shared else agents
        self.actor = StackedMLP(self.nets, [observed, *hidden, 2 * acted], self.random)
        self.critic, self.target = (
            StackedMLP(
                2 * self.nets, [seen, *hidden, 1], self.random, normalised=settings.normalised
            )
            for _ in range(2)
        )
        self.target.load_state_dict(self.critic.state_dict())
        self.averaged = deepcopy(self.actor)  # moving average, which is evaluated and exported
        for slow in (self.target, self.averaged):
            slow.requires_grad_(False)
        self.centre = torch.zeros(agents)  # mean rewards, which are subtracted
        self.log_alpha = torch.full((agents,), math.log(settings.alpha), requires_grad=True)
        self.optimizers = {
            name: torch.optim.Adam(parameters, lr=settings.lr, fused=True)
            for name, parameters in (
                ("actor", list(self.actor.parameters())),
                ("critic", list(self.critic.parameters())),
                ("alpha", [self.log_alpha]),
            )
        }
        self._mine = torch.eye(agents)[:, None, :, None]  # (i, 1, j, 1): whether j is i
        others = [[j for j in range(agents) if j != i] for i in range(agents)]
        self._others = torch.tensor(others, dtype=torch.long).view(agents, agents - 1)

    # ---- acting ---------------------------------------------------------------------------

    @torch.no_grad()
    def act(self, observation: NDArray[np.generic], explore: bool = True) -> NDArray[np.float32]:
        """Return actions (n, N, a) for observations (n, N, d).

        With `explore`, they are drawn from the actors' distributions; otherwise, they are the means
        of the averaged actors.
        """
        o = torch.as_tensor(observation, dtype=torch.float32).transpose(0, 1)
        if explore:
            action, _ = self._drawn(o)
        else:
            action = torch.tanh(self._acts(self.averaged, o)[..., : self.acted])
        return np.asarray(action.transpose(0, 1).contiguous().numpy())

    def _acts(self, actor: StackedMLP, o: Tensor) -> Tensor:
        """Return the actors' last layers (N, n, 2 a)."""
        folded: Tensor = actor(o.reshape(self.nets, -1, self.observed))
        return folded.view(*o.shape[:2], -1)

    def _drawn(self, o: Tensor) -> tuple[Tensor, Tensor]:
        """Draw actions (N, n, a) of the squashed Gaussians; return them and their log density."""
        mean, log_std = self._acts(self.actor, o).chunk(2, dim=-1)
        log_std = log_std.clamp(*LOG_STD)
        noise = torch.randn(mean.shape, generator=self.random)
        z = mean + log_std.exp() * noise
        log_normal = -0.5 * noise**2 - log_std - 0.5 * math.log(2.0 * math.pi)
        # log(1 - tanh(z)²), without cancellation
        log_slope = 2.0 * (math.log(2.0) - z - softplus(-2.0 * z))
        return torch.tanh(z), (log_normal - log_slope).sum(-1)

    # ---- learning -------------------------------------------------------------------------

    def update(self, drawn: Transitions, *, critic_only: bool = False) -> dict[str, float]:
        """Make one gradient step of each network; return the losses and alpha, means over agents.

        With `critic_only`, the actors and the temperatures are not changed.
        """
        columns = drawn.observation, drawn.action, drawn.after
        o, a, after = (torch.from_numpy(x).transpose(0, 1) for x in columns)
        r, ended = (torch.from_numpy(x).T for x in (drawn.reward, drawn.terminated))
        alpha = self.log_alpha.detach().exp()[:, None]
        with torch.no_grad():
            next_a, next_log = self._drawn(after)
            q_next = self._q(self.target, self._seen(after, next_a)).amin(1)
            y = r + self.settings.gamma * (1.0 - ended) * (q_next - alpha * next_log)
            y = y - self._offset(ended)
        q = self._q(self.critic, self._seen(o, a))
        if self.settings.centre:
            error = (y - q.detach().mean(1)).mean(1)
            self.centre += self.settings.centre * (error.mean() if self.settings.shared else error)
        critic_loss = 0.5 * ((q - y[:, None]) ** 2).mean(-1).sum()
        losses = {"critic_loss": self._descend("critic", critic_loss)}
        if not critic_only:
            losses |= self._improve(o, a, alpha)
            _follow(self.averaged, self.actor, self.settings.average)
        _follow(self.target, self.critic, self.settings.tau)
        return {**losses, "alpha": float(alpha.mean()), "q": float(q.detach().mean())}

    def _offset(self, ended: Tensor) -> Tensor:
        """Return the part of the targets y (N, n) that is due to the mean reward c.

        Naik et al., "Reward Centering", 2024. If this part is subtracted, the critics learn
        Q - c / (1 - gamma) instead of Q. The best action is the same, also where episodes end, and
        the critics need not first rise to c / (1 - gamma).
        """
        share = 1.0 - self.settings.gamma * (1.0 - ended)
        return self.centre[:, None] * share / max(1.0 - self.settings.gamma, 1e-9)

    def _improve(self, o: Tensor, a: Tensor, alpha: Tensor) -> dict[str, float]:
        drawn, log_pi = self._drawn(o)
        for p in self.critic.parameters():
            p.requires_grad_(False)
        q = self._q(self.critic, self._seen(o, a, drawn)).amin(1)
        for p in self.critic.parameters():
            p.requires_grad_(True)
        losses = {"actor_loss": self._descend("actor", (alpha * log_pi - q).mean(-1).sum())}
        entropy = -log_pi.detach().mean(-1)
        if self.settings.tune_alpha:
            wanted = -self.settings.h0 * self.acted
            self._descend("alpha", (self.log_alpha.exp() * (entropy - wanted)).sum())
        return {**losses, "entropy": float(entropy.mean())}

    def _descend(self, name: str, loss: Tensor) -> float:
        optimizer = self.optimizers[name]
        return descend("masac", f"{name}_loss", optimizer, loss, agents=self.agents, network=name)

    def _seen(self, o: Tensor, a: Tensor, own: Tensor | None = None) -> Tensor:
        """Return the inputs of each agent's critics (N, n, width).

        If `own` is given, these are the agents' own actions instead of those in `a`.
        """
        if not self.settings.central:
            return torch.cat([o, a if own is None else own], -1)
        n = o.shape[1]
        if self.settings.shared:  # itself, then the others
            first, rest = (o, a if own is None else own), (o[self._others], a[self._others])
            parts = zip(first, rest, strict=True)
            seen = [torch.cat([x[:, None], y], 1).transpose(1, 2) for x, y in parts]
            return torch.cat([x.reshape(self.agents, n, -1) for x in seen], -1)
        every_o = o.transpose(0, 1).reshape(1, n, -1).expand(self.agents, -1, -1)
        every_a = a.transpose(0, 1)[None].expand(self.agents, -1, -1, -1)
        if own is not None:
            every_a = torch.where(self._mine > 0, own.transpose(0, 1)[None], every_a)
        return torch.cat([every_o, every_a.reshape(self.agents, n, -1)], -1)

    def _q(self, critic: StackedMLP, seen: Tensor) -> Tensor:
        """Return the values of each agent's two critics, of shape (N, 2, n)."""
        folded = seen.reshape(self.nets, -1, seen.shape[-1]).repeat_interleave(2, 0)
        both: Tensor = critic(folded)
        if self.settings.shared:
            return both.view(2, self.agents, -1).transpose(0, 1)
        return both.squeeze(-1).view(self.agents, 2, -1)

    # ---- state ----------------------------------------------------------------------------

    def state(self) -> dict[str, object]:
        """Return the state of learning, for torch.save."""
        return {
            "actor": self.actor.state_dict(),
            "averaged": self.averaged.state_dict(),
            "critic": self.critic.state_dict(),
            "target": self.target.state_dict(),
            "log_alpha": self.log_alpha.detach().clone(),
            "centre": self.centre.clone(),
            "random": self.random.get_state(),
            **{f"adam_{k}": o.state_dict() for k, o in self.optimizers.items()},
        }

    def set_state(self, state: State) -> None:
        """Restore a state; raises KeyError or RuntimeError for another shape."""
        self.actor.load_state_dict(state["actor"])
        self.averaged.load_state_dict(state["averaged"])
        self.critic.load_state_dict(state["critic"])
        self.target.load_state_dict(state["target"])
        with torch.no_grad():
            self.log_alpha.copy_(state["log_alpha"])
            self.centre.copy_(state["centre"])
        self.random.set_state(state["random"])
        for name, optimizer in self.optimizers.items():
            optimizer.load_state_dict(state[f"adam_{name}"])

    def tensors(self, agent: int) -> dict[str, NDArray[np.float32]]:
        """Return the mean of an agent's averaged actor as the tensors of a `Policy`."""
        given: dict[str, NDArray[np.float32]] = {}
        agent, last = min(agent, self.nets - 1), len(self.averaged.weights) - 1
        for i, (w, b) in enumerate(zip(self.averaged.weights, self.averaged.biases, strict=True)):
            out = self.acted if i == last else w.shape[2]
            given[f"{i}.weight"] = w[agent, :, :out].detach().numpy().T.copy()
            given[f"{i}.bias"] = b[agent, 0, :out].detach().numpy().copy()
        return given


@torch.no_grad()
def _follow(slow: StackedMLP, fast: StackedMLP, share: float) -> None:
    for a, b in zip(slow.parameters(), fast.parameters(), strict=True):
        a.lerp_(b, share)
