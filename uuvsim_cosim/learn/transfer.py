"""Scenario transfer: what was learned in one task goes on in the next, actions exactly unchanged.

Agent i of the next team is a copy of agent i mod N of the last. Weights of inputs that were never
anything but zero are cleared in actors and critics, so that those which wake up say nothing until
they are learned; critics' columns for agents that were not there are zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.masac import Masac, MasacSettings
from uuvsim_cosim.learn.stacked import StackedMLP

__all__ = ["SHAPES", "transfer"]

SHAPES = ("hidden", "layers", "shared", "central")  # settings that must stay through a switch


@torch.no_grad()
def transfer(
    last: Masac,
    agents: int,
    awake: NDArray[np.bool_],
    columns: Sequence[int] | None = None,
    observed: int | None = None,
    seed: int = 0,
    settings: MasacSettings | None = None,
) -> Masac:
    """Give a learner for `agents` that acts as `last` does.

    `settings` are the next task's, by default the same; networks must be of the same shapes.

    `awake` (d,) says which numbers of the last task's observations have ever been other than zero.
    `columns` says where each of them stands in the next task's observations, of `observed`
    numbers; by default they are the same.
    """
    places = list(range(last.observed)) if columns is None else list(columns)
    width = last.observed if observed is None else observed
    if len(places) != last.observed or len(set(places)) < len(places):
        raise InputInvalid(
            f"columns: {len(places)} places; expected {last.observed}, all different"
        )
    if places and not 0 <= min(places) <= max(places) < width:
        raise InputInvalid(f"columns: {max(places)}; expected places in 0 … {width - 1}")
    if awake.shape != (last.observed,):
        raise InputInvalid(f"awake of shape {awake.shape}; expected ({last.observed},)")
    settings = settings or last.settings
    for name in SHAPES:
        now, was = getattr(settings, name), getattr(last.settings, name)
        if now != was:
            raise InputInvalid(f"{name} {now} after a switch; expected {was}, as before it")
    given = Masac(agents, width, last.acted, settings, seed)
    given.log_alpha.copy_(torch.stack([last.log_alpha[i % last.agents] for i in range(agents)]))
    given.centre.copy_(torch.stack([last.centre[i % last.agents] for i in range(agents)]))
    old = [i % last.nets for i in range(given.nets)]
    kept = torch.from_numpy(awake.astype(np.float32))
    for network in ("actor", "averaged", "critic", "target"):
        of, to = getattr(last, network), getattr(given, network)
        acts = network in ("actor", "averaged")
        each = 1 if acts else 2
        nets = [each * i + k for i in old for k in range(each)]
        _copy_later_layers(of, to, nets)
        first = torch.zeros_like(to.weights[0])
        for row, net in enumerate(nets):
            i = row // each
            pairs = [(i, old[i])] if acts else _pairs(last, given, i, old[i])
            for new, was in pairs:
                o_new, o_was = new * width, was * last.observed
                if acts:
                    o_new = o_was = 0
                source = of.weights[0][net, o_was : o_was + last.observed]
                first[row, [o_new + p for p in places]] = source * kept[:, None]
                if not acts:
                    _copy_actions(first[row], of.weights[0][net], given, last, new, was)
        to.weights[0].copy_(first)
    return given


def _pairs(last: Masac, given: Masac, i: int, was: int) -> list[tuple[int, int]]:
    """Say which agent of the last team stands in the place of which, for a critic of agent i."""
    if not last.settings.central:
        return [(0, 0)]
    others_new = [j for j in range(given.agents) if j != i]
    others_was = [j for j in range(last.agents) if j != was]
    return [(i, was), *zip(others_new, others_was, strict=False)]


def _copy_actions(
    row: Tensor, source: Tensor, given: Masac, last: Masac, new: int, was: int
) -> None:
    teams = (given.agents, last.agents) if last.settings.central else (1, 1)
    a_new = teams[0] * given.observed + new * last.acted
    a_was = teams[1] * last.observed + was * last.acted
    row[a_new : a_new + last.acted] = source[a_was : a_was + last.acted]


def _copy_later_layers(of: StackedMLP, to: StackedMLP, nets: list[int]) -> None:
    to.biases[0].copy_(of.biases[0][nets])
    for i in range(1, len(of.weights)):
        to.weights[i].copy_(of.weights[i][nets])
        to.biases[i].copy_(of.biases[i][nets])
