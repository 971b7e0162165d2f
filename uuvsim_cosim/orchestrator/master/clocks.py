"""Clocks of FMI 3.0 in the tables of the stepping loop: numbers, wires and first instants."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from math import lcm

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.component import Binding, Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.orchestrator.master.core import Core
from uuvsim_cosim.orchestrator.master.core_library import ClockKind, Event
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["add_clock_wires", "add_clocks", "cause_of", "clocks_of", "start_clocks"]

_Clocks = Mapping[int, Sequence[Variable]]  # by member, in the order of the loop
_CLOCK = 2  # the first number of `Event.cause` that is a clock
_KINDS = {"changing": ClockKind.CHANGING, "countdown": ClockKind.COUNTDOWN}
_DECIMAL, _FRACTION = 1, 2


def clocks_of(
    plan: Plan, components: Sequence[Component], order: Sequence[int]
) -> dict[int, list[Variable]]:
    """Return the input and output clocks of the members with Event Mode, by priority."""
    return {
        member: own
        for member, i in enumerate(order)
        if i in plan.event_group_of
        and (own := [v for v in components[i].description.clocks if v.causality != "local"])
    }


def add_clocks(
    core: Core,
    member: int,
    clocks: Sequence[Variable],
    binding: Binding,
    placed: Iterable[tuple[int, tuple[str, ...]]],
) -> None:
    """Add the clocks of a member; `placed` are the first slots of variables, with their clocks.

    Raises FmuError if the FMU lacks a function that its clocks need.
    """
    number = {v.name: k for k, v in enumerate(clocks)}
    names = ("GetClock", "SetClock", "GetIntervalDecimal", "GetIntervalFraction")
    functions = [binding.functions.get(name, 0) for name in names]
    core.clocks(member, functions)
    for v in clocks:
        kind, asks = _kind(v)
        needed = names[0] if kind == ClockKind.TRIGGERED_OUTPUT else names[1]
        for name in (needed, *([names[1 + asks]] if asks else [])):
            if name not in binding.functions:
                raise FmuError(f"clock {v.name}", f"its binary has no function fmi3{name}", "one")
        core.clock(member, v.value_references[0], kind, asks, _numbers(v.clocks, number))
    for slot, own in placed:
        if own:
            core.clocked(member, slot, _numbers(own, number))


def _kind(v: Variable) -> tuple[ClockKind, int]:
    """Return how the loop handles a clock, and how it asks for intervals during the run."""
    assert v.timing is not None
    if v.causality == "output":
        return ClockKind.TRIGGERED_OUTPUT, 0
    if not v.timing.is_time_based:
        return ClockKind.TRIGGERED_INPUT, 0
    kind = _KINDS.get(v.timing.variability, ClockKind.PERIODIC)
    asked = kind != ClockKind.PERIODIC or (
        v.timing.variability == "tunable" and v.timing.interval is None
    )
    return kind, (_FRACTION if v.timing.supports_fraction else _DECIMAL) if asked else 0


def _numbers(names: Iterable[str], number: Mapping[str, int]) -> list[int]:
    return [number[name] for name in names if name in number]


def add_clock_wires(core: Core, plan: Plan, order: Sequence[int], clocks: _Clocks) -> None:
    """Add the connections of clocks."""
    member = {i: m for m, i in enumerate(order)}
    for t in plan.clocks:
        ends = ((t.source, t.source_variable.name), (t.target, t.target_variable.name))
        source, target = (
            (member[i], [v.name for v in clocks[member[i]]].index(name)) for i, name in ends
        )
        core.clock_wire(source, target)


def start_clocks(
    core: Core,
    tick: Fraction,
    components: Sequence[Component],
    order: Sequence[int],
    clocks: _Clocks,
    start: int,
) -> None:
    """Set the first instants of all time-based clocks, before the run begins at tick `start`.

    Instants of periodic clocks are whole parts of a tick, so that no error adds up. Raises
    FmuError for a clock whose interval has no common part with the tick that fits 64 bits.
    """
    found = [
        (m, k, f"{c.path}.{v.name}", c.clock_starts[v.name])
        for m, own in clocks.items()
        if isinstance(c := components[order[m]], Fmu3)
        for k, v in enumerate(own)
        if v.name in c.clock_starts
    ]
    parts = 1
    for _, _, name, begin in found:
        if begin.is_periodic and begin.interval is not None:
            both = (begin.interval / tick, begin.shift / tick)
            parts = lcm(parts, *(x.denominator for x in both))
            if parts * max(tick.numerator, tick.denominator) >= 2**62:
                raise FmuError(
                    name,
                    f"its interval of {float(begin.interval):.17g} s has no common divisor with "
                    f"the tick of {float(tick):g} s that is large enough",
                    "another interval or another tick",
                )
    core.clock_parts(parts)
    for member, k, _, begin in found:
        if begin.is_periodic and begin.interval is not None:
            first = start * parts + int(begin.shift / tick * parts)
            period = int(begin.interval / tick * parts)
            core.clock_starts(
                member, k, divmod(first, parts), divmod(period, parts), float(begin.interval)
            )
        else:
            interval = None if begin.interval is None else float(begin.interval)
            core.clock_waits(member, k, start, interval)


def cause_of(event: Event, clocks: _Clocks) -> str:
    """Return the text of an event's cause."""
    if event.cause >= _CLOCK:
        return f"clock {clocks[event.member][event.cause - _CLOCK].name}"
    return "input" if event.cause else "reported"
