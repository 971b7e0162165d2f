"""The plan: a system flattened to tables of components, transfers and groups."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import Any

from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.system.elements import Algorithm, Loops, Solver
from uuvsim_cosim.orchestrator.system.variable_step import VariableStep
from uuvsim_cosim.orchestrator.values.transformation import Numbers

__all__ = [
    "AlgebraicLoop",
    "Group",
    "Plan",
    "PlannedBond",
    "PlannedComponent",
    "PlannedVariableStep",
    "Transfer",
]


@dataclass(frozen=True)
class PlannedComponent:
    """A component of the plan; one of its communication steps is `step_ticks` base steps."""

    path: str
    source: str
    description: Description
    start: Mapping[str, Any] = field(default_factory=dict)  # of the variable's shape, in its unit
    seed: tuple[int, int] = (0, 0)
    step_ticks: int = 1


@dataclass(frozen=True)
class Transfer:
    """Value flow: target element j gets factor · (source element i) + offset, pair by pair.

    If there is a `table`, it maps the source's numbers to the target's instead.
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

    An iterated group repeats its step until inputs and outputs at its end agree: until the
    residual is below tolerance · (1 + |input|). It fails after `limit` iterations.
    """

    algorithm: Algorithm
    members: tuple[int, ...]
    solver: Solver = "newton"
    tolerance: float = 1e-10
    limit: int = 100


@dataclass(frozen=True)
class AlgebraicLoop:
    """Outputs that depend on each other at once, through connections and direct feedthrough.

    `transfers` are indices of the plan's transfers in the loop, and `cycle` of those of one way
    around, in order. If hops ``b.u -> b.y`` are `undeclared`, there may be no feedthrough: the loop
    is delayed.
    """

    members: tuple[int, ...]  # indices into Plan.components
    transfers: tuple[int, ...]
    cycle: tuple[int, ...]
    iterated: bool = False
    undeclared: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlannedBond:
    """A power bond: (component, variable, element) of an input and an output of both sides."""

    name: str
    ends: tuple[
        tuple[int, str, int], tuple[int, str, int], tuple[int, str, int], tuple[int, str, int]
    ]


@dataclass(frozen=True)
class PlannedVariableStep:
    """A variable communication step of the components with a step of one tick, in ticks.

    `judged` are transfers, each with its absolute and its relative tolerance. The sources of
    `extrapolated` transfers are extrapolated over a step.
    """

    step: VariableStep
    smallest: int
    largest: int
    first: int
    judged: tuple[tuple[int, float, float], ...]
    extrapolated: tuple[int, ...]
    bonds: tuple[PlannedBond, ...]


@dataclass(frozen=True)
class Plan:
    """Tables by which the master steps a system; a pure function of the system.

    Time is the tick count k; one tick is `tick` seconds.
    At each communication point k, the inputs of every component that is due (k divisible by its
    `step_ticks`) are set from outputs valid at k, then each steps by ``step_ticks · tick``; its
    outputs become visible at k + step_ticks. Within a Gauss-Seidel group, a member's inputs are
    set just before it steps, and come from the outputs of this step for earlier members of the
    group. In an iterated group, inputs from other members are their outputs of this step.
    `initialization` lists the components in the order in which their outputs are known; an
    entry of more than one is an algebraic loop through declared (or undeclared) feedthrough.
    With a `variable` step, the components whose `step_ticks` is 1 all step by the same number of
    ticks, which their coupling chooses.
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
    start: Fraction = Fraction()  # s, time at which a run begins by default
    variable: PlannedVariableStep | None = None  # None: every step is a whole tick
    clocks: tuple[Transfer, ...] = ()  # connections of clocks, which carry ticks instead of values
    # Components that use Event Mode; those of a group have their events together. None: no events.
    events: tuple[tuple[int, ...], ...] | None = None

    @cached_property
    def event_group_of(self) -> Mapping[int, int]:
        """Number of the event group of each component that uses Event Mode."""
        return {i: n for n, members in enumerate(self.events or ()) for i in members}

    @cached_property
    def connected(self) -> Mapping[tuple[int, str], set[int]]:
        """Connected elements of each input, by (component, name); no entry if it has none."""
        found: dict[tuple[int, str], set[int]] = {}
        for t in self.transfers:
            elements = found.setdefault((t.target, t.target_variable.name), set())
            elements.update(t.target_elements)
        return found

    @cached_property
    def from_component(self) -> Mapping[int, Sequence[Transfer]]:
        """Transfers by their source component, in their order; no entry if it has none."""
        found: dict[int, list[Transfer]] = {}
        for t in self.transfers:
            found.setdefault(t.source, []).append(t)
        return found

    @cached_property
    def to_component(self) -> Mapping[int, Sequence[Transfer]]:
        """Transfers by their target component, in their order; no entry if it has none."""
        found: dict[int, list[Transfer]] = {}
        for t in self.transfers:
            found.setdefault(t.target, []).append(t)
        return found

    def longest_step(self, component: int) -> int:
        """Return the communication step of a component in ticks; of a variable one, the longest."""
        ticks = self.components[component].step_ticks
        return self.variable.largest if self.variable is not None and ticks == 1 else ticks

    def hop(self, t: Transfer) -> str:
        """Return the text of a transfer for messages, ``a.y -> b.u``."""
        source, target = self.components[t.source].path, self.components[t.target].path
        return f"{source}.{t.source_variable.name} -> {target}.{t.target_variable.name}"
