"""Decision transformer with its history, in NumPy: for a runner, and for evaluations.

The equations are those of models/intrinsics/transformer.py, for n parallel episodes. The return to
go starts at `wanted` and falls by `reward` with each action, since the observations do not contain
rewards.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

__all__ = ["Remembering"]


class Remembering:
    """Function from observations (n, width) to actions; call `begin` before new episodes."""

    def __init__(self, tensors: Any, settings: Any) -> None:
        self.t = {name: np.asarray(tensor, np.float32) for name, tensor in tensors.items()}
        self.context, self.heads = int(settings["context"]), int(settings["heads"])
        self.wanted = float(settings["return_to_go"])
        self.reward = float(settings.get("reward", 0.0))
        self.scale = float(settings.get("return_scale", 1.0))
        self.relu = {"relu": True, "gelu": False}[settings.get("activation", "gelu")]
        self.widths = (1, self.t["embed_observation.weight"].shape[1], len(self.t["head.bias"]))
        self.blocks = sum(name.endswith(".norm_1.weight") for name in self.t)
        self.begin()

    def begin(self) -> None:
        """Clear the history: the next observations are the first ones of new episodes."""
        self.past = 0  # actions so far
        # Returns to go, observations, actions: (n, K, width) each.
        self.history: list[np.ndarray] = []

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        """Return actions (n, width) in [-1, 1]."""
        o = np.asarray(observation, np.float32)
        if "shift" in self.t:
            o = (o - self.t["shift"]) * self.t["scale"]
        to_go = (self.wanted - self.past * self.reward) / self.scale
        now = (to_go, o, 0.0)  # the action is not known yet
        places = [np.zeros((len(o), self.context, w), np.float32) for w in self.widths]
        for i, place in enumerate(places):
            if self.past:
                place[:, :-1] = self.history[i][:, 1:]
            place[:, -1] = now[i]
        action: np.ndarray = np.tanh(self.network(places))
        places[2][:, -1] = action
        self.history, self.past = places, self.past + 1
        return action

    def network(self, places: list[np.ndarray]) -> np.ndarray:
        """Return the last action (n, width), before its tanh, from the three histories."""
        there = min(self.context, self.past + 1)  # places, the last ones
        table = self.t["embed_time.weight"]
        steps = np.arange(self.past + 1 - there, self.past + 1)
        time = table[np.minimum(steps, len(table) - 1)]
        names = ("embed_return", "embed_observation", "embed_action")
        tokens = [self.linear(k, places[i][:, -there:]) + time for i, k in enumerate(names)]
        x = np.stack(tokens, axis=2).reshape(len(places[0]), 3 * there, -1)[:, :-1]
        x = self.norm("embed_norm", x)
        for i in range(self.blocks):
            at = f"blocks.{i}."
            x = x + self.attention(at, self.norm(at + "norm_1", x))
            wide = self.activated(self.linear(at + "wide", self.norm(at + "norm_2", x)))
            x = x + self.linear(at + "narrow", wide)
        return self.linear("head", self.norm("norm", x[:, -1]))

    def linear(self, name: str, x: np.ndarray) -> np.ndarray:
        """Return W x + b."""
        return x @ self.t[name + ".weight"].T + self.t[name + ".bias"]

    def norm(self, name: str, x: np.ndarray) -> np.ndarray:
        """Return x with mean 0 and deviation 1, scaled and shifted."""
        x = x - x.mean(-1, keepdims=True)
        size = np.sqrt((x * x).mean(-1, keepdims=True) + np.float32(1e-5))
        return np.asarray(x / size * self.t[name + ".weight"] + self.t[name + ".bias"])

    def activated(self, x: np.ndarray) -> np.ndarray:
        """Return max(0, x), or gelu(x)."""
        if self.relu:
            y: np.ndarray = np.maximum(x, np.float32(0))
        else:
            y = 0.5 * x * (1.0 + np.vectorize(math.erf, otypes=[np.float32])(x / math.sqrt(2.0)))
        return y

    def attention(self, at: str, x: np.ndarray) -> np.ndarray:
        """Return attention in which each token sees itself and the tokens before it."""
        n, length, h = x.shape
        parts = self.linear(at + "attention.qkv", x).reshape(n, length, 3, self.heads, -1)
        q, k, v = parts.transpose(2, 0, 3, 1, 4)
        scores = q @ k.transpose(0, 1, 3, 2) / np.float32(math.sqrt(q.shape[3]))
        scores[..., np.triu(np.ones((length, length), bool), 1)] = -np.inf
        weights = np.exp(scores - scores.max(-1, keepdims=True))
        mixed = (weights / weights.sum(-1, keepdims=True)) @ v
        return self.linear(at + "attention.out", mixed.transpose(0, 2, 1, 3).reshape(n, length, h))
