"""Decision transformer: the next action is predicted from the sequence; no value is learned.

The UUVSim paper's equations (13) to (15), after Chen et al., "Decision Transformer" (2021): with
the return to go R_t = sum of r_k over k >= t, an episode is the sequence

    (13)  (R_1, s_1, a_1, R_2, s_2, a_2, …)
    (14)  a_t = pi(R_t-K+1, s_t-K+1, a_t-K+1, …, R_t, s_t)
    (15)  L = mean of |a_t - a_t of the data|²

The tensors have the names of models/intrinsics/transformer.py, which a vehicle runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from uuvsim_cosim.learn.algorithms.gradients import descend
from uuvsim_cosim.learn.data.dataset import Dataset
from uuvsim_cosim.learn.offline.offline_parts import (
    OfflineSettings,
    normalisation,
    policy_of,
)
from uuvsim_cosim.learn.policies.policy import Policy

__all__ = ["DecisionTransformer", "DtSettings", "Transformer"]


@dataclass(frozen=True)
class DtSettings(OfflineSettings):
    """Settings of the decision transformer: its form, and the return at which it aims."""

    hidden: int = 64  # width of a token
    blocks: int = 2  # number of transformer blocks
    heads: int = 2  # attention heads of each block
    context: int = 10  # K, the length of the sequence
    batch: int = 64  # sequences in one update
    steps: int = 2500  # updates
    wanted: float = 0.9  # the policy aims at this quantile of the returns in the data


class _Attention(nn.Module):
    def __init__(self, hidden: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv, self.out = nn.Linear(hidden, 3 * hidden), nn.Linear(hidden, hidden)

    def forward(self, x: Tensor, seen: Tensor) -> Tensor:
        q, k, v = (p.unflatten(2, (self.heads, -1)).transpose(1, 2)
                   for p in self.qkv(x).chunk(3, dim=2))  # fmt: skip
        mixed = nn.functional.scaled_dot_product_attention(q, k, v, attn_mask=seen)
        out: Tensor = self.out(mixed.transpose(1, 2).flatten(2))
        return out


class _Block(nn.Module):
    def __init__(self, hidden: int, heads: int) -> None:
        super().__init__()
        self.norm_1, self.norm_2 = nn.LayerNorm(hidden), nn.LayerNorm(hidden)
        self.attention = _Attention(hidden, heads)
        self.wide, self.narrow = nn.Linear(hidden, 4 * hidden), nn.Linear(4 * hidden, hidden)

    def forward(self, x: Tensor, seen: Tensor) -> Tensor:
        x = x + self.attention(self.norm_1(x), seen)
        out: Tensor = x + self.narrow(torch.relu(self.wide(self.norm_2(x))))
        return out


class Transformer(nn.Module):
    """Network from K returns to go, observations and actions, oldest first, to actions.

    The actions (n, K, a) are those before the tanh.
    """

    def __init__(self, observed: int, acted: int, times: int, s: DtSettings) -> None:
        super().__init__()
        self.embed_return, self.embed_observation = (
            nn.Linear(1, s.hidden),
            nn.Linear(observed, s.hidden),
        )
        self.embed_action, self.embed_time = (
            nn.Linear(acted, s.hidden),
            nn.Embedding(times, s.hidden),
        )
        self.embed_norm, self.norm = nn.LayerNorm(s.hidden), nn.LayerNorm(s.hidden)
        self.blocks = nn.ModuleList([_Block(s.hidden, s.heads) for _ in range(s.blocks)])
        self.head = nn.Linear(s.hidden, acted)

    def forward(self, to_go: Tensor, o: Tensor, a: Tensor, step: Tensor, there: Tensor) -> Tensor:
        """Return actions (n, K, a) before the tanh.

        The arguments are returns to go (n, K, 1), observations (n, K, d), actions (n, K, a), the
        numbers of the steps (n, K), and the mask of the steps that exist (n, K).
        """
        K = step.shape[1]
        time = self.embed_time(step)
        tokens = [self.embed_return(to_go), self.embed_observation(o), self.embed_action(a)]
        x = self.embed_norm(torch.stack([t + time for t in tokens], 2).flatten(1, 2))
        seen = (
            torch.ones(3 * K, 3 * K, dtype=torch.bool).tril()
            & there.repeat_interleave(3, 1)[:, None]
        )
        seen = seen | torch.eye(3 * K, dtype=torch.bool)  # a place that is not, sees itself
        for block in self.blocks:
            x = block(x, seen[:, None])
        out: Tensor = self.head(self.norm(x[:, 1::3]))
        return out


@final
class DecisionTransformer:
    """Decision transformer on a dataset; `update` is one step of Adam."""

    name = "dt"

    def __init__(self, data: Dataset, settings: DtSettings, seed: int) -> None:
        self.data, self.settings, K = data, settings, settings.context
        every = data.stacked()
        self._random = np.random.default_rng(seed)
        torch.manual_seed(seed)
        self._shift, self._scale = normalisation(every.observation[:, :-1][every.lived])
        # The places before an episode's start are there, as zeros that nobody sees.
        pad = [(0, 0), (K - 1, 0), (0, 0)]
        to_go = np.flip(np.cumsum(np.flip(every.reward, 1), 1), 1)[..., None]
        self.return_scale = max(1.0, float(np.abs(to_go).max()))
        o = (every.observation[:, :-1] - self._shift) * self._scale
        self._to_go, self._o, self._a = (
            torch.from_numpy(np.pad(x, pad).astype(np.float32))
            for x in (to_go / self.return_scale, o, every.action)
        )
        self._ends = np.argwhere(every.lived)  # (episode, last step) of each sequence
        length = every.action.shape[1]
        self.net = Transformer(len(data.observation), len(data.action), length, settings)
        self._adam = torch.optim.AdamW(self.net.parameters(), lr=settings.lr, weight_decay=1e-4)

    def update(self) -> dict[str, float]:
        """Make one update with sampled sequences; return the loss (15)."""
        K = self.settings.context
        episode, last = self._ends[
            self._random.integers(len(self._ends), size=self.settings.batch)
        ].T
        at = torch.from_numpy(last[:, None] + np.arange(K))  # in the padded arrays
        step = at - (K - 1)
        rows, there = torch.from_numpy(episode)[:, None], step >= 0
        to_go, o, a = (x[rows, at] for x in (self._to_go, self._o, self._a))
        acted = torch.tanh(self.net(to_go, o, a, step.clamp(min=0), there))
        loss = ((acted - a) ** 2).mean(-1)[there].mean()
        return {"loss": descend("dt", "loss", self._adam, loss)}

    def policy(self) -> Policy:
        """Return the policy learned so far, of kind "sequence"."""
        s, returns = self.settings, self.data.returns
        wanted = float(np.quantile(returns, s.wanted))
        most = max(len(e.action) for e in self.data.episodes)
        tensors: dict[str, NDArray[np.float32]] = {
            k: v.detach().numpy().copy() for k, v in self.net.state_dict().items()
        }
        settings = {
            "context": s.context, "heads": s.heads, "activation": "relu", "return_to_go": wanted,
            "return_scale": self.return_scale, "reward": wanted / most,
        }  # fmt: skip
        tensors |= {"shift": self._shift, "scale": self._scale}
        return policy_of(self.data, "sequence", tensors, settings)
