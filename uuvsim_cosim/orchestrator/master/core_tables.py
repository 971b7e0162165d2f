"""Tables of the stepping loop, made from a plan and its live components: slots and addresses."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import groupby
from typing import get_args

import numpy as np

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.isolation.isolated import Isolated
from uuvsim_cosim.orchestrator.master.callback import CallbackBinding, component_binding
from uuvsim_cosim.orchestrator.master.clocks import add_clock_wires, add_clocks, clocks_of
from uuvsim_cosim.orchestrator.master.core import Access, Core
from uuvsim_cosim.orchestrator.master.core_library import (
    Action,
    StepControl,
    Type,
    by_type,
    encode,
)
from uuvsim_cosim.orchestrator.master.shared import Serve, SharedBinding, shared_binding
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent, PlannedVariableStep
from uuvsim_cosim.orchestrator.system.elements import Solver
from uuvsim_cosim.orchestrator.values.values import conversion

__all__ = ["Placed", "Tables", "fmi_name", "tables_of"]


@dataclass(frozen=True)
class Placed:
    """A variable of a component, and its first slot; element i (from 0) is at slot + i."""

    member: int
    variable: Variable
    slot: int
    discrete: bool = False  # an input that is set in Event Mode only
    clocks: tuple[str, ...] = ()  # set or read only while one of them is active

    @property
    def slots(self) -> range:
        """Return the variable's slots."""
        return range(self.slot, self.slot + self.variable.size)

    def view(self, values: np.ndarray) -> np.ndarray:
        """Return the variable's part of the loop's `slots` or `fresh`."""
        return values[self.slot : self.slot + self.variable.size]


@dataclass(frozen=True)
class Tables:
    """The core with its tables, and the slots of the variables; members are in stepping order."""

    core: Core
    plan: Plan
    order: tuple[int, ...]  # member -> index into Plan.components
    bindings: tuple[Binding, ...]  # by member
    inputs: dict[tuple[int, str], Placed]  # by (index into Plan.components, name)
    outputs: dict[tuple[int, str], Placed]
    clocks: dict[int, list[Variable]]  # by member, in the order of the loop

    def replace(self, member: int, component: Component) -> None:
        """Put another instance of the same FMU in a member's place."""
        binding = self.bindings[member]
        if isinstance(binding, CallbackBinding):
            binding.callbacks.serve(component)
        elif isinstance(binding, SharedBinding) and isinstance(component, Isolated):
            binding.exchange.exchange_with(component)
        else:
            binding = component.binding()
            self.core.instance(member, binding.instance, binding.functions.get("StateKept", 0))
            if self.order[member] in self.plan.event_group_of:
                self.core.inside(member, binding.functions["InEventMode"])

    def raw(self, placed: Placed) -> np.ndarray:
        """Return the slots of a variable: a view, valid until the core is freed."""
        return placed.view(self.core.slots)

    def forget_inputs(self) -> None:
        """Let callbacks set every input at the next step, also those that have not changed."""
        for binding in self.bindings:
            if isinstance(binding, CallbackBinding):
                binding.callbacks.forget()

    @cached_property
    def unconnected(self) -> list[tuple[int, Placed]]:
        """Inputs that the loop sets and of which some elements are not connected."""
        return [
            (key[0], placed)
            for key, placed in self.inputs.items()
            if len(self.plan.connected.get(key, ())) < placed.variable.size
        ]

    def show_unconnected(self, components: Sequence[Component]) -> None:
        """Copy the present values of the unconnected inputs into the loop's slots.

        The loop sets whole inputs in each step, so these slots must hold what a component has.
        """
        for i, placed in self.unconnected:
            if not placed.clocks:
                encode(placed.variable, components[i].get(placed.variable), self.raw(placed))

    def placed_at(self, slot: int) -> tuple[Placed, int]:
        """Find the variable and the element (from 0) of a slot."""
        for p in (*self.inputs.values(), *self.outputs.values()):
            if slot in p.slots:
                return p, slot - p.slot
        raise LookupError(slot)


def tables_of(
    plan: Plan,
    components: Sequence[Component],
    recorded: Sequence[tuple[int, Variable]],
    every: int = 1,
    n_rows: int = 0,
    live: Sequence[tuple[int, Variable]] = (),
    held: Sequence[tuple[int, Variable]] = (),
    serve: Serve | None = None,
    core_of: Callable[[int, int, Fraction], Core] = Core,
) -> Tables:
    """Number the slots, and fill in the tables of the core that `core_of` makes.

    `recorded` are (index into Plan.components, variable) of the columns of a row. Variables of
    `live` are read, and inputs of `held` are set, in every step as well. `serve` steps an isolated
    component in its process; it is required if there is one.
    """
    order = tuple(i for group in plan.groups for i in group.members)
    bindings: list[Binding] = []  # how the loop calls each member
    for component in (components[i] for i in order):
        binding = component.binding()
        if binding.kind == BindingKind.CALLBACK and not binding.functions:
            binding = component_binding(component)
        elif binding.kind == BindingKind.SHARED:
            assert serve is not None  # a component in a child process is itself not isolated
            binding = shared_binding(component, serve)
        bindings.append(binding)
    clocks = clocks_of(plan, components, order)
    inputs = _place(plan, _exchanged(plan, components, order, bindings, held, outputs=False), 0)
    first_output = sum(p.variable.size for p in inputs.values())
    read = [*recorded, *live]
    outputs = _place(
        plan, _exchanged(plan, components, order, bindings, read, outputs=True), first_output
    )
    n_slots = first_output + sum(p.variable.size for p in outputs.values())
    core = core_of(len(order), n_slots, plan.tick)
    set_, got = _by_member(inputs, len(order)), _by_member(outputs, len(order))
    sequential = {i for g in plan.groups if g.algorithm != "jacobi" for i in g.members}
    for member, i in enumerate(order):
        b = bindings[member]
        get = b.functions.get("UpdateOutputs" if b.kind == BindingKind.NATIVE else "Get", 0)
        step = _function(b, "DoStep", components[i].path)
        ticks = plan.components[i].step_ticks
        kept = b.functions.get("StateKept", 0)
        path = components[i].path
        core.member(member, b.kind, b.instance, step, get, kept, ticks, i in sequential, path)
        for action, own in ((Action.SET, set_[member]), (Action.GET, got[member])):
            for access in _accesses(b, action, own, components[i].path):
                core.access(member, access)
        if i in plan.event_group_of:
            _use_event_mode(core, member, plan.event_group_of[i], components[i], b, set_[member])
        if member in clocks:
            placed_ = [*set_[member], *got[member]]
            add_clocks(core, member, clocks[member], b, [(p.slot, p.clocks) for p in placed_])
        if b.kind == BindingKind.FMI1:
            for placed in (*set_[member], *got[member]):
                for slot in placed.slots if placed.variable.negated else ():
                    core.negate(member, slot)
        if "DoSteps" in b.functions:  # a component of this package
            offsets = [i for p in (*set_[member], *got[member]) for i in _offsets(p.variable)]
            bounds = [x for p in set_[member] for x in [_bounds(b, p.variable)] * p.variable.size]
            find = b.functions.get("FindValues", 0)
            core.in_place(member, find, b.functions["DoSteps"], offsets, bounds)
        if isinstance(b, SharedBinding):
            b.exchange.open(*([p.variable for p in own[member]] for own in (set_, got)))
        if b.kind == BindingKind.NATIVE and "GetFMUState" in b.functions:
            core.state(member, *_state_functions(b, components[i]))
    tables = Tables(core, plan, order, tuple(bindings), inputs, outputs, clocks)
    _add_transfers(plan, tables)
    add_clock_wires(core, plan, order, clocks)
    first = 0
    for group in plan.groups:
        size = len(group.members)
        if group.algorithm == "iterated":  # a step is repeated from the states at its start
            for member in range(first, first + size):
                functions = _state_functions(bindings[member], components[order[member]])
                core.state(member, *functions)
            solver = get_args(Solver).index(group.solver)
            core.iterate(first, size, solver, group.tolerance, group.limit)
        first += size
    if plan.variable is not None:
        _vary(plan.variable, tables, components)
    if recorded:
        columns = [outputs.get((i, v.name)) or inputs[i, v.name] for i, v in recorded]
        core.record([slot for placed in columns for slot in placed.slots], every, n_rows)
    return tables


_FMI = {BindingKind.FMI1: "fmi", BindingKind.FMI2: "fmi2", BindingKind.FMI3: "fmi3"}
_Exchanged = Iterator[tuple[int, int, Iterable[Variable]]]  # member, component, variables


def _exchanged(
    plan: Plan,
    components: Sequence[Component],
    order: Sequence[int],
    bindings: Sequence[Binding],
    further: Sequence[tuple[int, Variable]],
    *,
    outputs: bool,
) -> _Exchanged:
    """Yield the inputs that the loop sets, or the outputs that it reads, of each member.

    They are those of the transfers, and `further` ones by component. A component that is called
    back in Python, here or in its own process, exchanges all.
    """
    more: dict[int, set[str]] = {}
    for i, v in further:
        more.setdefault(i, set()).add(v.name)
    for member, i in enumerate(order):
        b, described = bindings[member], components[i].description
        if BindingKind.CALLBACK in (b.kind, b.served if isinstance(b, SharedBinding) else b.kind):
            yield member, i, described.of("output", "local") if outputs else described.of("input")
            continue
        if outputs:
            names = {t.source_variable.name for t in plan.from_component.get(i, ())}
        else:
            names = {t.target_variable.name for t in plan.to_component.get(i, ())}
        names |= more.get(i, set())
        found = (v for v in described.variables.values() if v.name in names)
        yield member, i, [v for v in found if v.type != "Clock"]


def _place(plan: Plan, exchanged: _Exchanged, first: int) -> dict[tuple[int, str], Placed]:
    placed = {}
    for member, i, variables in exchanged:

        def discrete(
            v: Variable, events: bool = i in plan.event_group_of
        ) -> tuple[bool, tuple[str, ...]]:
            own = events and v.causality == "input" and v.variability != "continuous"
            return own, v.clocks if events else ()

        for v in by_type(sorted(variables, key=discrete)):
            placed[i, v.name] = Placed(member, v, first, *discrete(v))
            first += v.size
    return placed


def _by_member(placed: Mapping[tuple[int, str], Placed], n: int) -> list[list[Placed]]:
    found: list[list[Placed]] = [[] for _ in range(n)]
    for p in placed.values():
        found[p.member].append(p)
    return found


def _accesses(b: Binding, action: Action, placed: Sequence[Placed], path: str) -> Iterator[Access]:
    """Yield the calls that set or get a member's variables, one for each type."""
    for (type_, *_), same in groupby(placed, lambda p: (Type.of(p.variable), p.discrete, p.clocks)):
        run = list(same)
        count = sum(p.variable.size for p in run)
        of = _offsets if b.kind == BindingKind.NATIVE else lambda v: v.value_references
        references = [reference for p in run for reference in of(p.variable)]
        function = 0
        if b.kind in _FMI:
            function = _function(b, fmi_name(b.kind, action, type_), path)
        yield Access(action, type_, run[0].slot, count, tuple(references), function)


def _offsets(v: Variable) -> range:
    """Return the places of a variable's elements in the block of a component of this package."""
    return range(v.value_references[0], v.value_references[0] + v.size)


def _bounds(b: Binding, v: Variable) -> tuple[float, float]:
    """Return the bounds that the component checks when an input is set."""
    if b.kind == BindingKind.NATIVE:
        return -math.inf, math.inf
    most = sys.float_info.max
    widest = {"Float64": (-most, most), "Int32": (-(2.0**31), 2.0**31 - 1.0)}
    low, high = widest.get(v.type, (0.0, 1.0))
    return (low if v.min is None else max(low, v.min), high if v.max is None else min(high, v.max))


def fmi_name(kind: BindingKind, action: Action, type_: Type) -> str:
    """Return FMI's function for a type, without prefix: ``GetFloat64``, ``SetReal``."""
    verb = "Set" if action == Action.SET else "Get"
    if kind == BindingKind.FMI3:
        return verb + type_.name
    if type_ in (Type.Boolean, Type.String):
        return verb + type_.name
    return verb + ("Real" if type_ == Type.Float64 else "Integer")


def _function(b: Binding, name: str, path: str) -> int:
    if name not in b.functions:
        prefix = _FMI.get(b.kind, "")
        raise FmuError(path, f"its binary has no function {prefix}{name}", "one")
    return b.functions[name]


def _add_transfers(plan: Plan, tables: Tables) -> None:
    """Add the plan's transfers, and the inputs whose residuals are those of angles."""
    group_of = {i: n for n, g in enumerate(plan.groups) for i in g.members}
    member_of = {i: member for member, i in enumerate(tables.order)}
    for t in plan.transfers:
        turns: dict[str | None, float] = {}  # a full turn in a unit of angles, 0 in another unit
        source = tables.outputs[t.source, t.source_variable.name]
        target = tables.inputs[t.target, t.target_variable.name]
        same = group_of[t.source] == group_of[t.target]
        algorithm = plan.groups[group_of[t.source]].algorithm if same else "jacobi"
        # 0: delayed by a step; 1: from a member that has stepped already; 2: iterated.
        early = 2 * (algorithm == "iterated") or int(
            algorithm == "gauss-seidel"
            and member_of[t.source] < member_of[t.target]
            and plan.components[t.source].step_ticks <= plan.components[t.target].step_ticks
        )
        for a, b in zip(t.source_elements, t.target_elements, strict=True):
            slots = (target.slot + b, source.slot + a)
            core = tables.core
            core.transfer(target.member, source.member, slots, early, (t.factor, t.offset), t.table)
            unit = t.target_variable.unit_of_element(b)
            if unit not in turns:
                turns[unit] = _turn(unit, plan.components[t.target])
            if turns[unit]:
                core.angle(slots[0], turns[unit])


def _turn(unit: str | None, component: PlannedComponent) -> float:
    """Return a full turn in a unit of angles, 0 in another unit."""
    of_angle = conversion("rad", unit, component.description.units) if unit else None
    return 2.0 * math.pi * of_angle[0] if of_angle else 0.0


def _vary(variable: PlannedVariableStep, tables: Tables, components: Sequence[Component]) -> None:
    """Let the loop choose the step's length, from what it is to judge."""
    plan, core, step = tables.plan, tables.core, variable.step
    proportional, integral = step.gains
    core.vary(
        StepControl(
            smallest=variable.smallest, largest=variable.largest, first=variable.first,
            absolute=step.absolute, relative=step.relative, safety=step.safety,
            slowest=step.slowest, fastest=step.fastest, proportional=proportional,
            integral=integral, order=step.order, rollback=step.rollback,
        )
    )  # fmt: skip
    extrapolated: dict[int, None] = {}
    for t in (plan.transfers[n] for n in variable.extrapolated):
        first = tables.outputs[t.source, t.source_variable.name].slot
        for a, b in zip(t.source_elements, t.target_elements, strict=True):
            unit = t.target_variable.unit_of_element(b)
            if not _turn(unit, plan.components[t.target]):  # an angle jumps by a turn: it is held
                extrapolated[first + a] = None
    for slot in extrapolated:
        core.extrapolate(slot)
    for n, absolute, relative in variable.judged:
        t = plan.transfers[n]
        source = tables.outputs[t.source, t.source_variable.name].slot
        target = tables.inputs[t.target, t.target_variable.name].slot
        for a, b in zip(t.source_elements, t.target_elements, strict=True):
            slots = target + b, source + a
            core.judge(slots, (t.factor, t.offset), absolute, relative)
    for bond in variable.bonds:
        sides = zip((tables.inputs, tables.outputs) * 2, bond.ends, strict=True)
        core.bond([placed[i, name].slot + element for placed, (i, name, element) in sides])
    if step.rollback:
        for member, i in enumerate(tables.order):
            core.state(member, *_state_functions(tables.bindings[member], components[i]))


def _use_event_mode(
    core: Core, member: int, group: int, component: Component, b: Binding, inputs: list[Placed]
) -> None:
    names = ("EnterEventMode", "UpdateDiscreteStates", "EnterStepMode")
    functions = [_function(b, name, component.path) for name in names]
    repeats = component.description.can_get_and_set_state
    core.event_mode(member, group, functions, repeats)
    core.inside(member, b.functions["InEventMode"])
    if repeats:
        core.state(member, *_state_functions(b, component))
    for placed in inputs:
        if placed.discrete and placed.slots:
            core.discrete(member, placed.slot)


def _state_functions(b: Binding, component: Component) -> tuple[int, int, int, int]:
    """Return the addresses that get, set and free a state, and its size (native only)."""
    suffix = "FMUstate" if b.kind == BindingKind.FMI2 else "FMUState"
    get, set_ = (_function(b, verb + suffix, component.path) for verb in ("Get", "Set"))
    size = b.functions.get("StateSize", 0)
    return get, set_, b.functions.get("Free" + suffix, 0), size
