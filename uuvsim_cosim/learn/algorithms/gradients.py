"""Gradient steps: checks for NaN, and clipping of norms."""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch
from torch import Tensor

from uuvsim_cosim.learn.shared.errors import LearningDiverged

__all__ = ["check_gradients", "clip_by_network", "descend"]


def descend(
    algorithm: str, name: str, optimizer: torch.optim.Optimizer, loss: Tensor, *, agents: int = 1,
    network: str = "",
) -> float:  # fmt: skip
    """Make a gradient step on the sum of the agents' losses; return their mean.

    Raises LearningDiverged, before any network changes, if the loss or a gradient is not finite.
    The message names the loss `name`, or the gradient of `network` (by default `name`).
    """
    value = float(loss.detach()) / agents
    if not math.isfinite(value):
        raise LearningDiverged(algorithm, name, value)
    optimizer.zero_grad(set_to_none=True)
    loss.backward()  # type: ignore[no-untyped-call]
    check_gradients(algorithm, network or name, optimizer.param_groups[0]["params"])
    optimizer.step()
    return value


def check_gradients(algorithm: str, name: str, parameters: Iterable[Tensor]) -> None:
    """Raise LearningDiverged if a gradient is not finite."""
    given = [p.grad for p in parameters if p.grad is not None]
    if not given:
        return
    norm = float(torch.stack(torch._foreach_norm(given)).sum())
    if not math.isfinite(norm):
        raise LearningDiverged(algorithm, f"the gradient of {name}", norm)


@torch.no_grad()
def clip_by_network(parameters: Iterable[Tensor], most: float) -> None:
    """Scale down gradients to the norm `most`, separately for each network (the first axis)."""
    given = [p.grad for p in parameters if p.grad is not None]
    squares = torch.stack([g.flatten(1).square().sum(1) for g in given]).sum(0)
    scale = (most / (squares.sqrt() + 1e-6)).clamp(max=1.0)
    for g in given:
        g.mul_(scale.view(-1, *[1] * (g.dim() - 1)))
