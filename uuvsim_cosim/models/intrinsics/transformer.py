"""A decision transformer as an intrinsic: an action from a history of returns, seen and done.

Chen et al., "Decision Transformer" (2021): K places of three tokens each, the return to go R, the
observation o and the action a, oldest first, each embedded, with the time of its place added:

    x = norm(W_R R + b_R + time_t),  norm(W_o o + b_o + time_t),  norm(W_a a + b_a + time_t)

then blocks  x += out(attention(norm_1(x))),  x += narrow(f(wide(norm_2(x)))),  causal, over the
places that there have been; the action is head(last norm(x)) at the token of the last o. As a
network (network.py) it is called by name; the C is fmus/runtime/intrinsics/uuv_transformer.h.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.intrinsics.network import registered

__all__ = ["Transformer", "transformer"]

Array = NDArray[np.float32]
_LAYERS = ("attention.qkv", "attention.out", "wide", "narrow")


@dataclass(frozen=True)
class Transformer:
    """Its tensors by name, "embed_return.weight" … "head.bias", and its form.

    Names are those of a torch module: embed_return, embed_observation, embed_action (Linear),
    embed_time (Embedding), embed_norm, norm (LayerNorm), head (Linear), and in blocks.0, blocks.1,
    …: norm_1, norm_2 (LayerNorm), attention.qkv, attention.out, wide, narrow (Linear).
    """

    name: str
    tensors: Mapping[str, Array]
    places: int
    heads: int
    activation: Literal["relu", "gelu"]

    @property
    def hidden(self) -> int:
        """Return the width of a token."""
        return len(self.tensors["norm.weight"])

    @property
    def observed(self) -> int:
        """Return the width of an observation."""
        return int(self.tensors["embed_observation.weight"].shape[1])

    @property
    def n_out(self) -> int:
        """Return the width of an action."""
        return len(self.tensors["head.bias"])

    @property
    def n_in(self) -> int:
        """Return the number of inputs: the actions so far, and K times R, o and a."""
        return 1 + self.places * (1 + self.observed + self.n_out)

    @property
    def blocks(self) -> int:
        """Return the number of blocks."""
        return sum(name.endswith(".norm_1.weight") for name in self.tensors)

    @property
    def widest(self) -> int:
        """Return the size of the widest layer."""
        layers = [k for k in self.tensors if k.endswith(".weight") and k != "embed_time.weight"]
        return int(max(extent for k in layers for extent in self.tensors[k].shape))

    def __call__(self, x: NDArray[Any]) -> Array:
        """Return the last action (n_out,), before a tanh, of the inputs (n_in,)."""
        x = np.asarray(x, np.float32)
        past, rows = int(x[0]), x[1:].reshape(self.places, -1)
        there = np.arange(self.places) >= self.places - 1 - past
        steps = past - np.arange(self.places)[::-1]
        table = self.tensors["embed_time.weight"]
        time = table[np.clip(steps, 0, len(table) - 1)]
        parts = np.split(rows, [1, 1 + self.observed], axis=1)
        names = ("embed_return", "embed_observation", "embed_action")
        tokens = [self._linear(n, p) + time for n, p in zip(names, parts, strict=True)]
        h = self._norm("embed_norm", np.stack(tokens, axis=1).reshape(-1, self.hidden)[:-1])
        seen = np.tril(np.ones((len(h), len(h)), bool)) & np.repeat(there, 3)[None, :-1]
        for i in range(self.blocks):
            at = f"blocks.{i}."
            h = h + self._attention(at, self._norm(f"{at}norm_1", h), seen)
            wide = self._linear(f"{at}wide", self._norm(f"{at}norm_2", h))
            if self.activation == "relu":
                wide = np.maximum(wide, np.float32(0))
            else:
                erf = np.vectorize(math.erf)(wide.astype(float) / math.sqrt(2.0))
                wide = np.asarray(0.5 * wide * (1.0 + erf), np.float32)
            h = h + self._linear(f"{at}narrow", wide)
        return np.asarray(self._linear("head", self._norm("norm", h[-1:]))[0], np.float32)

    def _linear(self, name: str, x: Array) -> Array:
        return np.asarray(x @ self.tensors[f"{name}.weight"].T + self.tensors[f"{name}.bias"])

    def _norm(self, name: str, x: Array) -> Array:
        mean = x.mean(axis=1, keepdims=True)
        size = np.sqrt(((x - mean) ** 2).mean(axis=1, keepdims=True) + np.float32(1e-5))
        scaled = (x - mean) / size * self.tensors[f"{name}.weight"]
        return np.asarray(scaled + self.tensors[f"{name}.bias"])

    def _attention(self, at: str, x: Array, seen: NDArray[np.bool_]) -> Array:
        q, k, v = (
            part.reshape(len(x), self.heads, -1).transpose(1, 0, 2)
            for part in np.split(self._linear(f"{at}attention.qkv", x), 3, axis=1)
        )
        scores = q @ k.transpose(0, 2, 1) / np.float32(math.sqrt(q.shape[2]))
        scores = np.where(seen, scores, np.float32(-1e30))
        weights = np.exp(scores - scores.max(axis=2, keepdims=True)) * seen
        total = weights.sum(axis=2, keepdims=True)
        mixed = (weights / np.where(total == 0, np.float32(1), total)) @ v
        return self._linear(f"{at}attention.out", mixed.transpose(1, 0, 2).reshape(len(x), -1))


def transformer(
    tensors: Mapping[str, Array], places: int, heads: int, activation: Literal["relu", "gelu"]
) -> Callable[[ca.SX], ca.SX]:
    """Return a decision transformer as a function of an SX (n_in,) with values (n_out,).

    The inputs are the number of actions so far, then place by place, oldest first, R, o and a; the
    last a counts for nothing. Raises ParameterInvalid.
    """
    kept = {k: np.ascontiguousarray(v, np.float32) for k, v in sorted(tensors.items())}
    _check(kept, places, heads, activation)
    digest = hashlib.sha256(f"transformer {places} {heads} {activation}".encode())
    for name, tensor in kept.items():
        digest.update(f"{name} {tensor.shape}".encode() + tensor.astype("<f4").tobytes())
    name = f"network_{digest.hexdigest()[:12]}"
    return registered(Transformer(name, kept, places, heads, activation))


def _check(tensors: Mapping[str, Array], places: int, heads: int, activation: str) -> None:
    blocks = sum(name.endswith(".norm_1.weight") for name in tensors)
    h = len(tensors.get("norm.weight", ()))
    if not h or heads < 1 or h % heads or places < 1 or activation not in ("relu", "gelu"):
        raise ParameterInvalid(
            "transformer",
            f"{places} places, {heads} heads of {h} numbers together, activation {activation!r}",
            "1 or more, a divisor of the width, relu or gelu",
        )
    seen = tensors.get("embed_observation.weight", np.zeros((h, 1))).shape[-1]
    acted = len(tensors.get("head.bias", (0,)))
    wide = len(tensors.get("blocks.0.wide.bias", (0,)))
    linear: dict[str, tuple[int, int]] = {"embed_return": (h, 1), "embed_observation": (h, seen),
              "embed_action": (h, acted), "head": (acted, h)}  # fmt: skip
    expected: dict[str, tuple[int, ...]] = {"norm.weight": (h,), "norm.bias": (h,)}
    expected |= {"embed_norm.weight": (h,), "embed_norm.bias": (h,)}
    for i in range(blocks):
        sizes = ((3 * h, h), (h, h), (wide, h), (h, wide))
        linear |= {f"blocks.{i}.{k}": s for k, s in zip(_LAYERS, sizes, strict=True)}
        for norm in ("norm_1", "norm_2"):
            expected |= {f"blocks.{i}.{norm}.{k}": (h,) for k in ("weight", "bias")}
    for name, (rows, columns) in linear.items():
        expected |= {f"{name}.weight": (rows, columns), f"{name}.bias": (rows,)}
    for name, shape in expected.items():
        found = tensors.get(name)
        if found is None or found.shape != shape or not np.all(np.isfinite(found)):
            read = "none" if found is None else f"one of shape {found.shape}"
            raise ParameterInvalid(
                "transformer", f"tensor {name!r}: {read}", f"finite numbers of shape {shape}"
            )
    table = tensors.get("embed_time.weight")
    if table is None or table.ndim != 2 or table.shape[1] != h:
        raise ParameterInvalid("transformer", "tensor 'embed_time.weight'", f"(times, {h})")
