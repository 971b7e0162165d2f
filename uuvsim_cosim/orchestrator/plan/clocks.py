"""Clocks of FMI 3.0 in a plan: what has them needs events, and what they carry must fit."""

from __future__ import annotations

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["check_clocks", "clock_notes"]


def check_clocks(plan: Plan) -> None:
    """Refuse components whose clocks cannot tick, and connections that would lose ticks or values.

    Raises SystemInvalid with every problem.
    """
    problems: list[Problem] = []
    group = plan.event_group_of
    for i, c in enumerate(plan.components):
        if i in group or not c.description.clocks:
            continue
        names = ", ".join(v.name for v in c.description.clocks)
        if plan.events is None and c.description.has_event_mode:
            expected = "a run with events (--events, System.with_events)"
        else:
            expected = (
                "an FMU for Co-Simulation with hasEventMode and "
                "canHandleVariableCommunicationStepSize"
            )
        read = f"it has clocks ({names}), which tick in Event Mode only"
        problems.append(Problem(f"clocks: {c.path}", read, expected))
    if problems:  # the connections of these components are no other problem
        raise SystemInvalid(problems)
    for t in plan.clocks:
        if group[t.source] != group[t.target]:
            read = "joins clocks of components that do not have their events together"
            expected = "components with equal communication steps"
            problems.append(Problem(f"clocks: {plan.hop(t)}", read, expected))
    for t in plan.transfers:
        lost = t.source_variable.clocks and not t.target_variable.clocks
        triggered = [n for n in t.source_variable.clocks if not _is_time_based(plan, t.source, n)]
        if lost and triggered:
            read = f"joins a variable of the triggered clock {triggered[0]} to one without a clock"
            expected = "a clocked input, and a connection of its clock"
            problems.append(Problem(f"clocks: {plan.hop(t)}", read, expected))
    if problems:
        raise SystemInvalid(problems)


def clock_notes(plan: Plan) -> list[str]:
    """Return what is assumed of connections between clocked and other variables."""
    notes = []
    for t in plan.transfers:
        a, b = t.source_variable, t.target_variable
        if a.clocks and not b.clocks:
            notes.append(f"clocks: {plan.hop(t)}: the value holds between ticks of {_list(a)}")
        elif b.clocks and not a.clocks:
            notes.append(f"clocks: {plan.hop(t)}: the value is sampled at ticks of {_list(b)}")
    return notes


def _list(v: Variable) -> str:
    return ", ".join(v.clocks)


def _is_time_based(plan: Plan, component: int, name: str) -> bool:
    timing = plan.components[component].description.variables[name].timing
    return timing is not None and timing.is_time_based
