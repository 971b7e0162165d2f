"""Scenario transfer: the networks of one task continue in the next; actions are unchanged.

Agent i of the next team starts as a copy of agent i mod N of the previous team. In actors and
critics, the weights of inputs that were always zero are set to zero, so that such an input has no
effect until its weights are learned. The critics' weights for agents that were not in the previous
team are zero, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.masac import Masac, MasacSettings
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP

__all__ = ["SHAPES", "in_the_place_of", "pass_on", "transfer"]

SHAPES = ("hidden", "layers", "shared", "central")  # settings that must stay through a switch


@torch.no_grad()
def transfer(
    last: Masac, agents: int, awake: NDArray[np.bool_], *, seed: int = 0,
    settings: MasacSettings | None = None,
) -> Masac:  # fmt: skip
    """Return the networks of `agents` agents that act exactly as those of `last`.

    `settings` are those of the next task, by default the same. `awake` (d,) marks the observed
    numbers that have ever been nonzero in the previous task. Raises InputInvalid for settings that
    change the shapes of the networks.
    """
    settings = settings or last.settings
    for name in SHAPES:
        now, was = getattr(settings, name), getattr(last.settings, name)
        if now != was:
            raise InputInvalid(f"{name} {now} after a switch", f"{was}, as before it")
    given = Masac(agents, last.observed, last.acted, settings, seed)
    source = [i % last.agents for i in range(agents)]
    given.log_alpha.copy_(last.log_alpha[source])
    given.centre.copy_(last.centre[source])
    old = [i % last.nets for i in range(given.nets)]
    own = [[(0, 0)]] * given.nets
    for name in ("actor", "averaged"):
        pass_on(getattr(last, name), getattr(given, name), old, own, awake)
    if settings.central:
        own = [in_the_place_of(i, agents, was, last.agents) for i, was in enumerate(old)]
    nets = [2 * i + k for i in old for k in range(2)]  # both critics of each
    both = [pairs for pairs in own for _ in range(2)]
    for name in ("critic", "target"):
        pass_on(getattr(last, name), getattr(given, name), nets, both, awake, acted=last.acted)
    return given


def in_the_place_of(i: int, agents: int, was: int, before: int) -> list[tuple[int, int]]:
    """Return pairs (agent, agent of the previous team) for the central critic of agent i.

    The team has `agents` agents, the previous one had `before`; agent i is a copy of agent `was`.
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
    *,
    acted: int = 0,
) -> None:
    """Copy networks of the stack `of` into the stack `to`; `nets` has one number for each of `to`.

    The inputs of a network are one block of d observed numbers for each agent, then one block of
    `acted` numbers for each agent. `blocks` has for each network pairs (block of the new network,
    block of the old one). All other inputs get the weight zero, and so do observed numbers that
    were always zero, according to `awake` (d,). Raises InputInvalid for networks of other shapes.
    """
    now, before = ([int(w.shape[2]) for w in stack.weights] for stack in (to, of))
    if now != before:
        raise InputInvalid(f"networks of widths {now} after a switch", f"{before}, as before it")
    nets, width = list(nets), len(awake)
    kept = torch.from_numpy(awake.astype(np.float32))[:, None]
    n_new, n_was = (stack.weights[0].shape[1] // (width + acted) for stack in (to, of))
    first = torch.zeros_like(to.weights[0])
    for row, (net, pairs) in enumerate(zip(nets, blocks, strict=True)):
        source = of.weights[0][net]
        for new, was in pairs:
            seen = source[was * width : (was + 1) * width]
            first[row, new * width : (new + 1) * width] = seen * kept
            a_new, a_was = n_new * width + new * acted, n_was * width + was * acted
            first[row, a_new : a_new + acted] = source[a_was : a_was + acted]
    to.weights[0].copy_(first)
    to.biases[0].copy_(of.biases[0][nets])
    for i in range(1, len(of.weights)):
        to.weights[i].copy_(of.weights[i][nets])
        to.biases[i].copy_(of.biases[i][nets])
