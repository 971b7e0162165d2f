"""The plan: a system flattened to tables of components, transfers and groups."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.system.elements import Algorithm, Loops, Solver
from uuvsim_cosim.orchestrator.values.value_table import Numbers

__all__ = [
    "AlgebraicLoop",
    "Group",
    "Plan",
    "PlannedComponent",
    "Transfer",
]


@dataclass(frozen=True)
class PlannedComponent:
    """A component as the master will run it; `step_ticks` base steps are one of its own."""

    path: str
    source: str
    description: Description
    start: Mapping[str, Any] = field(default_factory=dict)  # of the variable's shape, in its unit
    seed: tuple[int, int] = (0, 0)
    step_ticks: int = 1


@dataclass(frozen=True)
class Transfer:
    """Value flow: target element j gets factor · (source element i) + offset, pair by pair.

    Where there is a `table` of numbers, it says what becomes of a value instead.
    """

    source: int  # index into Plan.components
    source_variable: Variable
    source_elements: tuple[int, ...]
    target: int
    target_variable: Variable
    target_elements: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0
    table: Numbers = ()


@dataclass(frozen=True)
class Group:
    """Components stepped together: all at once (Jacobi), in this order (Gauss-Seidel), or iterated.

    An iterated group repeats its step until inputs and outputs at its end agree: the solver
    leaves a residual below tolerance · (1 + |input|), or gives up after `limit` iterations.
    """

    algorithm: Algorithm
    members: tuple[int, ...]
    solver: Solver = "newton"
    tolerance: float = 1e-10
    limit: int = 100


@dataclass(frozen=True)
class AlgebraicLoop:
    """Outputs that depend on each other at once, through connections and direct feedthrough.

    `transfers` are the plan's that lie in the loop, and `cycle` those of one way around, in
    order. If hops ``b.u -> b.y`` of it are `undeclared`, it may be none: it is delayed.
    """

    members: tuple[int, ...]  # indices into Plan.components
    transfers: tuple[int, ...]
    cycle: tuple[int, ...]
    iterated: bool = False
    undeclared: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """A pure function of the system. Time is the tick count k; one tick is `tick` seconds.

    At each communication point k, the inputs of every component that is due (k divisible by its
    `step_ticks`) are set from outputs valid at k, then each steps by ``step_ticks · tick``; its
    outputs become visible at k + step_ticks. Within a Gauss-Seidel group, a member's inputs are
    set just before it steps and see what earlier members of the group produced in this step.
    In an iterated group, inputs from other members are what those produce in this step.
    `initialization` lists the components in the order in which their outputs are known; an
    entry of more than one is an algebraic loop through declared (or undeclared) feedthrough.
    `algebraic_loops` lists these loops, and how the policy `loops` treats them in stepping.
    """

    tick: Fraction
    components: tuple[PlannedComponent, ...]
    transfers: tuple[Transfer, ...]
    groups: tuple[Group, ...]
    initialization: tuple[tuple[int, ...], ...]
    warnings: tuple[str, ...] = ()
    algebraic_loops: tuple[AlgebraicLoop, ...] = ()
    loops: Loops = "delay"
    start: Fraction = Fraction()  # s, where a run begins unless it is told otherwise
