"""Many small networks of one shape as one: layers whose weights have a leading axis of networks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

__all__ = ["StackedMLP"]


@final
class StackedMLP(nn.Module):
    """`count` perceptrons of widths (in, hidden, …, out), ReLU between; x (count, batch, in).

    Each layer is one baddbmm for all networks. Weights begin uniform in ±1/sqrt(in), as
    torch.nn.Linear's, drawn from `generator`.
    """

    def __init__(self, count: int, widths: Sequence[int], generator: torch.Generator) -> None:
        super().__init__()
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
        """Give (count, batch, out)."""
        last = len(self.weights) - 1
        for i, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = torch.baddbmm(b, x, w)
            if i < last:
                x = torch.relu(x)
        return x

    def tensors(self, network: int) -> dict[str, NDArray[np.float32]]:
        """Give one of the networks as the layers of a `Policy`: weights (out, in), biases."""
        given: dict[str, NDArray[np.float32]] = {}
        for i, (w, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            given[f"{i}.weight"] = w[network].detach().numpy().T.copy()
            given[f"{i}.bias"] = b[network, 0].detach().numpy().copy()
        return given
