"""Scenario transfer: the networks of one task continue in the next, actions exactly unchanged.

Agent i of the next team is a copy of agent i mod N of the last. In actors and critics, the weights
of inputs that were always zero are cleared, so that such an input has no effect until its weights
are learned. The critics' weights for agents that were not in the last team are zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.masac import Masac, MasacSettings
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP

__all__ = ["SHAPES", "in_the_place_of", "pass_on", "transfer"]

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
    """Return a learner for `agents` that acts as `last` does.

    `settings` are the next task's, by default the same; networks must be of the same shapes.
    `awake` (d,) marks the numbers of the last task's observations that have ever been nonzero.
    `columns` gives the place of each number in the next task's observations, of `observed`
    numbers; by default the places are the same.
    """
    places = list(range(last.observed)) if columns is None else list(columns)
    width = last.observed if observed is None else observed
    if len(places) != last.observed or len(set(places)) < len(places):
        raise InputInvalid("columns", f"{len(places)} places", f"{last.observed}, all different")
    if places and not 0 <= min(places) <= max(places) < width:
        raise InputInvalid("columns", max(places), f"places in 0 … {width - 1}")
    if awake.shape != (last.observed,):
        raise InputInvalid(f"awake of shape {awake.shape}", f"({last.observed},)")
    settings = settings or last.settings
    for name in SHAPES:
        now, was = getattr(settings, name), getattr(last.settings, name)
        if now != was:
            raise InputInvalid(f"{name} {now} after a switch", f"{was}, as before it")
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
            pairs = [(i, old[i])]  # (agent, agent of the last team in whose place it stands)
            if not acts:
                central = last.settings.central
                pairs = in_the_place_of(i, agents, old[i], last.agents) if central else [(0, 0)]
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


def in_the_place_of(i: int, agents: int, was: int, before: int) -> list[tuple[int, int]]:
    """Return pairs (agent, agent of the last team) for a central critic of agent i.

    `agents` are in the team, `before` were in the last; i begins as a copy of `was`.
    """
    others_new = [j for j in range(agents) if j != i]
    others_was = [j for j in range(before) if j != was]
    return [(i, was), *zip(others_new, others_was, strict=False)]


@torch.no_grad()
def pass_on(
    of: StackedMLP,
    to: StackedMLP,
    nets: Sequence[int],
    blocks: Sequence[Sequence[tuple[int, int]]],
    awake: NDArray[np.bool_],
) -> None:
    """Copy networks `nets` of a stack, one for each network of `to`.

    Inputs are blocks of d numbers each, as `awake` (d,). `blocks` has for each network pairs (block
    of the new network, block of the old one). All other inputs get the weight zero, and so do
    numbers that were always zero. Raises InputInvalid for networks of other shapes.
    """
    if _widths(of) != _widths(to):
        raise InputInvalid(
            f"networks of widths {_widths(to)} after a switch", f"{_widths(of)}, as before it"
        )
    _copy_later_layers(of, to, list(nets))
    kept, width = torch.from_numpy(awake.astype(np.float32))[:, None], len(awake)
    first = torch.zeros_like(to.weights[0])
    for row, (net, pairs) in enumerate(zip(nets, blocks, strict=True)):
        for new, was in pairs:
            source = of.weights[0][net, was * width : (was + 1) * width]
            first[row, new * width : (new + 1) * width] = source * kept
    to.weights[0].copy_(first)


def _widths(network: StackedMLP) -> list[int]:
    return [int(w.shape[2]) for w in network.weights]


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
