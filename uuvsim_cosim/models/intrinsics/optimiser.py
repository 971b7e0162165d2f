"""Optimisers as intrinsics: one function call in the equations, in C by CasADi's own generator.

As a table (table.py) or a network (network.py), an optimiser is a CasADi Function that equations
call and never inline; an emitter finds it in `OPTIMISERS` by its name. It is called at the ticks of
a clock and has no derivative. It is no part of a kernel, whose lanes would wait for one another.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

__all__ = ["OPTIMISERS", "optimiser"]

OPTIMISERS: dict[str, ca.Function] = {}


def optimiser(function: ca.Function) -> Callable[..., list[ca.SX]]:
    """Return a CasADi Function as one of SX columns; its name identifies all that it depends on."""
    OPTIMISERS.setdefault(function.name(), function)
    return lambda *inputs: list(OPTIMISERS[function.name()].call([*inputs], False, True))
