"""Multilayer perceptrons as intrinsics: one function call in the equations, whatever their size.

Weights are data of the intrinsic, not parameters. As a table (table.py), a network is a CasADi
Callback that is called and never inlined, named by the hash of its contents; an emitter finds the
weights in `NETWORKS`. Everything is float32: a sum is one of parts of 16 products, each added from
the first on, as fmus/runtime/intrinsics/uuv_network.h adds, so that both give the same bits.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.intrinsics.callback import CALLBACKS, register_callback

__all__ = ["CHUNK", "NETWORKS", "Activation", "Layer", "Network", "network", "registered"]

Array = NDArray[np.float32]
Activation = Literal["linear", "relu", "tanh"]
CHUNK = 16  # products of a part of a sum: UUV_CHUNK


@dataclass(frozen=True)
class Layer:
    """y = f(weight x + bias), of weight (out, in) and bias (out,)."""

    weight: Array
    bias: Array
    activation: Activation = "linear"


@dataclass(frozen=True)
class Network:
    """Layers, one after the other."""

    name: str
    layers: tuple[Layer, ...]

    @property
    def n_in(self) -> int:
        """Return the number of inputs."""
        return int(self.layers[0].weight.shape[1])

    @property
    def n_out(self) -> int:
        """Return the number of outputs."""
        return len(self.layers[-1].bias)

    @property
    def widest(self) -> int:
        """Return the size of the largest layer, the inputs included."""
        return max(self.n_in, *(len(layer.bias) for layer in self.layers))

    def __call__(self, x: Array) -> Array:
        """Return the outputs (n_out,) of inputs (n_in,), to the bits of the C."""
        return self._forward(np.asarray(x, np.float32)[:, None])[0][:, 0]

    def jacobian(self, x: Array) -> Array:
        """Return d outputs / d inputs, of shape (n_out, n_in)."""
        return self._forward(np.asarray(x, np.float32)[:, None])[1]

    def _forward(self, x: Array) -> tuple[Array, Array]:
        dx = np.eye(self.n_in, dtype=np.float32)
        for layer in self.layers:
            x = sums(layer.weight, x, layer.bias)
            dx = layer.weight @ dx
            if layer.activation == "relu":
                dx = dx * (x > 0)
                x = np.where(x < 0, np.float32(0), x)
            elif layer.activation == "tanh":
                x = np.tanh(x.astype(np.float64)).astype(np.float32)
                dx = dx * (1 - x * x)
        return x, np.asarray(dx, np.float32)


def sums(weight: Array, x: Array, bias: Array) -> Array:
    """Return weight @ x + bias of columns x (in, n), added in the order of the C."""
    total = np.repeat(bias[:, None], x.shape[1], axis=1)
    for first in range(0, len(x), CHUNK):
        part = np.zeros_like(total)
        for i in range(first, min(first + CHUNK, len(x))):
            part += weight[:, i : i + 1] * x[i]
        total += part
    return total


class Intrinsic(Protocol):
    """A function that the equations call by its name, and whose data the C code holds."""

    @property
    def name(self) -> str: ...
    @property
    def n_in(self) -> int: ...
    @property
    def n_out(self) -> int: ...
    def __call__(self, x: NDArray[Any], /) -> NDArray[Any]: ...


# By name: a Network, a Transformer (transformer.py) or a Field (field.py).
NETWORKS: dict[str, Intrinsic] = {}


def network(layers: Sequence[Layer]) -> Callable[[ca.SX], ca.SX]:
    """Return a multilayer perceptron as a function of an SX (n_in,) with values (n_out,)."""
    if not layers:
        raise ParameterInvalid("network", "no layers", "one or more")
    kept: list[Layer] = []
    digest = hashlib.sha256()
    width = layers[0].weight.shape[-1]
    for i, layer in enumerate(layers):
        weight = np.ascontiguousarray(layer.weight, np.float32)
        bias = np.ascontiguousarray(layer.bias, np.float32)
        if weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]:
            raise ParameterInvalid(
                "network",
                f"layer {i} has weights {weight.shape} and bias {bias.shape}",
                f"(n, {width}) and (n,)",
            )
        if not (weight.size and np.all(np.isfinite(weight)) and np.all(np.isfinite(bias))):
            raise ParameterInvalid(f"network: layer {i} has no weights, or NaN or infinity in them")
        if layer.activation not in get_args(Activation):
            known = ", ".join(get_args(Activation))
            raise ParameterInvalid("network", f"activation {layer.activation!r}", known)
        width = len(bias)
        digest.update(f"{weight.shape} {layer.activation} ".encode())
        digest.update(weight.astype("<f4").tobytes() + bias.astype("<f4").tobytes())
        kept.append(Layer(weight, bias, layer.activation))
    return registered(Network(f"network_{digest.hexdigest()[:12]}", tuple(kept)))


def registered(made: Intrinsic) -> Callable[[ca.SX], ca.SX]:
    """Register an intrinsic; return it as a function of an SX (n_in,) with values (n_out,).

    Its derivative is its method `jacobian`, (n_out, n_in); without one it has none.
    """
    name, n_in, n_out = made.name, made.n_in, made.n_out
    if name not in NETWORKS:
        NETWORKS[name] = made

        def register(
            name: str, function: Callable[..., Any], columns: int, *gradients: ca.Function
        ) -> ca.Function:
            def of_column(x: ca.DM) -> Any:
                return function(np.array(x).ravel())

            return register_callback(name, of_column, [n_in], (n_out, columns), gradients)

        jacobian = getattr(made, "jacobian", None)
        gradients = [register(f"{name}_jacobian", jacobian, n_in)] if jacobian is not None else []
        register(name, made, 1, *gradients)
    return lambda x: CALLBACKS[name].call([x], False, True)[0]
