"""Stacked networks: several small networks of one shape, computed as one batch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.autograd import Function

__all__ = ["StackedMLP"]

EPS = 1e-5  # added to a variance
MASK = (True, False, False)  # gradient of the input only: there are no gains and shifts


@final
class StackedMLP(nn.Module):
    """Stack of `count` perceptrons with layers of `widths` (in, hidden, …, out) and ReLU between.

    An input has the shape (count, batch, in). Each layer is one `torch.baddbmm` for all networks.
    The initial weights are uniform in ±1/sqrt(in), as those of `torch.nn.Linear`, and drawn from
    `generator`. With `normalised`, the inputs of the ReLU functions of a layer are normalised to
    mean 0 and variance 1 over the layer (Ba et al., "Layer Normalization", 2016, without learned
    gains and shifts).
    """

    def __init__(
        self,
        count: int,
        widths: Sequence[int],
        generator: torch.Generator,
        *,
        normalised: bool = False,
    ) -> None:
        super().__init__()
        self.normalised = normalised
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for fan_in, fan_out in pairwise(widths):
            bound = 1.0 / math.sqrt(fan_in)
            for kept, shape in (
                (self.weights, (count, fan_in, fan_out)),
                (self.biases, (count, 1, fan_out)),
            ):
                drawn = torch.rand(shape, generator=generator)
                kept.append(nn.Parameter(bound * (2.0 * drawn - 1.0)))

    def forward(self, x: Tensor) -> Tensor:
        """Return the outputs (count, batch, out) for inputs (count, batch, in)."""
        given: Tensor = _Layers.apply(  # type: ignore[no-untyped-call]
            self.normalised, x, *self.weights, *self.biases
        )
        return given

    def tensors(self, network: int) -> dict[str, NDArray[np.float32]]:
        """Return one network as the layers of a `Policy`: weights (out, in) and biases (out,)."""
        given: dict[str, NDArray[np.float32]] = {}
        for i, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            given[f"{i}.weight"] = w[network].detach().numpy().T.copy()
            given[f"{i}.bias"] = b[network, 0].detach().numpy().copy()
        return given


class _Layers(Function):
    """All layers as one node of autograd's graph.

    The gradients of this node are contiguous. Autograd's gradients of baddbmm are transposed, which
    makes the mask of ReLU thirty times slower and costs an eighth of a whole update.
    """

    @staticmethod
    def forward(ctx: Any, normalised: bool, x: Tensor, *parameters: Tensor) -> Tensor:
        depth = len(parameters) // 2
        inputs, norms = [], []
        for i, (w, b) in enumerate(zip(parameters[:depth], parameters[depth:], strict=True)):
            inputs.append(x)
            x = torch.baddbmm(b, x, w)
            if i == depth - 1:
                break
            if normalised:
                before = x
                x, *moments = torch.native_layer_norm(before, x.shape[-1:], None, None, EPS)
                norms += [before, *moments]
            x = x.relu_()
        ctx.save_for_backward(*inputs, *parameters[:depth], *norms)
        ctx.depth = depth
        return x

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        depth, saved = ctx.depth, ctx.saved_tensors
        inputs, weights, norms = saved[:depth], saved[depth : 2 * depth], saved[2 * depth :]
        of_weights: list[Tensor | None] = [None] * depth
        of_biases: list[Tensor | None] = [None] * depth
        wanted = ctx.needs_input_grad[1:]
        for i in reversed(range(depth)):
            if wanted[1 + i]:
                of_weights[i] = torch.bmm(inputs[i].transpose(1, 2), grad)
                of_biases[i] = grad.sum(1, keepdim=True)
            if i or wanted[0]:
                back = weights[i].transpose(1, 2)
                grad = grad * back if back.shape[1] == 1 else torch.bmm(grad, back)
            if i:  # 0 where ReLU gave 0; in place, as fresh memory costs more than the sums
                torch.ops.aten.threshold_backward.grad_input(grad, inputs[i], 0, grad_input=grad)
                if norms:
                    before, mean, rstd = norms[3 * i - 3 : 3 * i]
                    grad, _, _ = torch.ops.aten.native_layer_norm_backward(
                        grad, before, before.shape[-1:], mean, rstd, None, None, MASK
                    )
        return (None, grad if wanted[0] else None, *of_weights, *of_biases)
