"""A policy with a memory acts: n histories of K returns, observations and actions, numpy alone.

The same as models/transformer.py and models/policy_sequence.py, for n episodes side by side.
"""

from __future__ import annotations

import math
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policy import Policy

__all__ = ["SequenceRunner", "begin"]

Array = NDArray[np.float32]


def begin(policy: Any) -> None:
    """Tell what acts that episodes begin: a memory is emptied."""
    if isinstance(policy, SequenceRunner):
        policy.begin()


@final
class SequenceRunner:
    """Acts as a policy of one observation does, and remembers; `begin` before new episodes.

    The return to go falls by `reward` an action, since observations do not tell it.
    """

    def __init__(self, policy: Policy) -> None:
        s = policy.settings
        try:
            if policy.kind != "sequence":
                raise ValueError(f"kind {policy.kind!r}")
            self.context, self.heads = int(s["context"]), int(s["heads"])
            self.wanted, self.reward = float(s["return_to_go"]), float(s.get("reward", 0.0))
            self.scale = float(s.get("return_scale", 1.0))
            self._relu = {"relu": True, "gelu": False}[s.get("activation", "gelu")]
            self._t = {k: np.asarray(v, np.float32) for k, v in policy.tensors.items()}
            self._blocks = sum(k.endswith(".norm_1.weight") for k in self._t)
            self._times = len(self._t["embed_time.weight"])
        except (KeyError, ValueError) as error:
            raise InputInvalid(
                f"policy of {policy.task}: {error}; expected a decision transformer, with its "
                "settings"
            ) from None
        self.policy = policy
        self.begin()

    def begin(self) -> None:
        """Forget: the next observations are first ones."""
        self._past = 0
        self._history: list[Array] = []

    def __call__(self, observation: NDArray[Any]) -> NDArray[np.float64]:
        """Act on observations (n, width), one action after those before."""
        o = np.asarray(observation, np.float32)
        n, seen, acts, K = (
            len(o),
            len(self.policy.observation),
            len(self.policy.action),
            self.context,
        )
        if o.ndim != 2 or o.shape[1] != seen:
            raise InputInvalid(
                f"policy of {self.policy.task}: observations of shape {o.shape}; expected "
                f"(n, {seen})"
            )
        if "shift" in self._t:
            o = (o - self._t["shift"]) * self._t["scale"]
        if self._past and len(self._history[0]) != n:
            raise InputInvalid(
                f"policy of {self.policy.task}: {n} episodes after {len(self._history[0])}; "
                "expected as many, or begin()"
            )
        if not self._past:
            self._history = [np.zeros((n, K, w), np.float32) for w in (1, seen, acts)]
        to_go = np.full((n, 1), (self.wanted - self._past * self.reward) / self.scale, np.float32)
        now = to_go, o, np.zeros((n, acts), np.float32)
        self._history = [
            np.concatenate([h[:, 1:], x[:, None]], 1)
            for h, x in zip(self._history, now, strict=True)
        ]
        action = np.tanh(self._network())
        self._history[2][:, -1] = action
        self._past += 1
        return action.astype(np.float64)

    # ---- the network ----------------------------------------------------------------------

    def _network(self) -> Array:
        K, n = self.context, len(self._history[0])
        there = min(K, self._past + 1)  # places, the last ones
        steps = np.arange(self._past + 1 - there, self._past + 1)
        time = self._t["embed_time.weight"][np.minimum(steps, self._times - 1)]
        names = ("embed_return", "embed_observation", "embed_action")
        parts = [
            self._linear(k, h[:, -there:]) + time for k, h in zip(names, self._history, strict=True)
        ]
        x = np.stack(parts, axis=2).reshape(n, 3 * there, -1)[:, :-1]
        x = self._norm("embed_norm", x)
        later = np.triu(np.ones((x.shape[1],) * 2, bool), 1)
        for i in range(self._blocks):
            at = f"blocks.{i}."
            x = x + self._attention(at, self._norm(f"{at}norm_1", x), later)
            wide = self._activated(self._linear(f"{at}wide", self._norm(f"{at}norm_2", x)))
            x = x + self._linear(f"{at}narrow", wide)
        return self._linear("head", self._norm("norm", x[:, -1]))

    def _linear(self, name: str, x: Array) -> Array:
        return np.asarray(x @ self._t[f"{name}.weight"].T + self._t[f"{name}.bias"])

    def _norm(self, name: str, x: Array) -> Array:
        x = x - x.mean(-1, keepdims=True)
        size = np.sqrt((x * x).mean(-1, keepdims=True) + np.float32(1e-5))
        return np.asarray(x / size * self._t[f"{name}.weight"] + self._t[f"{name}.bias"])

    def _activated(self, x: Array) -> Array:
        if self._relu:
            return np.maximum(x, np.float32(0))
        from scipy.special import erf

        return np.asarray(0.5 * x * (1.0 + erf(x / math.sqrt(2.0))), np.float32)

    def _attention(self, at: str, x: Array, later: NDArray[np.bool_]) -> Array:
        n, length, h = x.shape
        q, k, v = (
            p.reshape(n, length, self.heads, -1).transpose(0, 2, 1, 3)
            for p in np.split(self._linear(f"{at}attention.qkv", x), 3, axis=2)
        )
        scores = q @ k.transpose(0, 1, 3, 2) / np.float32(math.sqrt(q.shape[3]))
        scores[..., later] = -np.inf
        weights = np.exp(scores - scores.max(-1, keepdims=True))
        mixed = (weights / weights.sum(-1, keepdims=True)) @ v
        return self._linear(f"{at}attention.out", mixed.transpose(0, 2, 1, 3).reshape(n, length, h))
