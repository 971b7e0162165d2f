"""Gain of an algebraic loop: the change of one input after one way around the loop.

With x the inputs inside the loop and G = d(new x)/dx, through the members' direct feedthrough and
the connections, x = G x + b has one solution if I - G is regular. A loop whose connections delay
by a step follows x_k+1 = G x_k + b, which diverges if an eigenvalue of G is larger than 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.plan.initial_loop import feedthrough, is_singular
from uuvsim_cosim.orchestrator.plan.plan import AlgebraicLoop, Plan
from uuvsim_cosim.orchestrator.plan.start import enter_initialization
from uuvsim_cosim.orchestrator.system.resolve import resolve

__all__ = ["LoopGain", "delay_remark", "estimated_gain", "gain_text", "loop_gain"]

_REAL = 1e-9  # an imaginary part below it, relative to the magnitude, is rounding


@dataclass(frozen=True)
class LoopGain:
    """Gain of a loop, for its users' messages and for the convergence of delayed stepping."""

    around: float  # gain of one way around the named cycle, with its sign if it is real
    growth: float  # of an error per step, if every connection of the loop delays
    is_singular: bool


def loop_gain(
    plan: Plan, loop: AlgebraicLoop, components: Sequence[Component], time: float
) -> LoopGain | None:
    """Return the gain at the components' present values; None if the loop carries no numbers.

    The components are in Initialization Mode. Derivatives are their own where they provide them,
    else finite differences.
    """
    transfers = [plan.transfers[k] for k in loop.transfers]
    matrix, rows = feedthrough(transfers, components, time)
    places = [rows[loop.transfers.index(k)] for k in loop.cycle]
    if not all(places):
        return None
    around = np.eye(len(places[-1]))
    for before, here in zip([places[-1], *places], places, strict=False):
        around = matrix[np.ix_(here, before)] @ around
    largest = max(np.linalg.eigvals(around), key=abs)
    real = abs(largest.imag) <= _REAL * abs(largest)
    return LoopGain(
        float(largest.real if real else abs(largest)),
        float(max(abs(np.linalg.eigvals(matrix)))),
        is_singular(matrix),
    )


def estimated_gain(plan: Plan, loop: AlgebraicLoop) -> LoopGain | None:
    """Return the gain at the start values of the members; None if it cannot be determined.

    Instances of the members are made for it, and freed.
    """
    place = {i: k for k, i in enumerate(loop.members)}
    planned = tuple(plan.components[i] for i in loop.members)
    transfers = tuple(
        replace(t, source=place.get(t.source, -1), target=place.get(t.target, -1))
        for t in plan.transfers
    )
    components: list[Component] = []
    try:
        for c in planned:
            components.append(resolve(c.source).instantiate(c.path, backend="native"))
            enter_initialization(c, components[-1], {}, None, (0.0, None))
        alone = replace(plan, components=planned, transfers=transfers)
        return loop_gain(alone, loop, components, 0.0)
    except Exception:  # the estimate is for an error message, which its failure must not replace
        return None
    finally:
        for component in components:
            component.free()


def delay_remark(hops: str, gain: LoopGain | None) -> str:
    """Return a sentence for a loop that does not converge if it is delayed, else nothing."""
    if gain is None or gain.growth < 1.0 - 1e-9:
        return ""
    return (
        f"algebraic loop {hops}: {gain_text(gain)}, with which its delayed connections do not "
        "converge; expected --loops iterate, or a gain of magnitude below 1"
    )


def gain_text(gain: LoopGain | None) -> str:
    """Write an estimated gain."""
    return "its gain is not known" if gain is None else f"its estimated gain is {gain.around:.4g}"
