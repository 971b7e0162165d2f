"""Events across FMUs: the components that use Event Mode, and those that have events together."""

from __future__ import annotations

from dataclasses import replace

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.orchestrator.plan.clocks import clock_notes
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["with_events"]


def with_events(plan: Plan, *, varies: bool) -> Plan:
    """Return the plan with its event groups; raises SystemInvalid with every problem.

    A component uses Event Mode if it is a Co-Simulation FMU of FMI 3.0 with ``hasEventMode``.
    Components that use it, are connected to each other and have equal communication steps are a
    group. An FMU whose communication steps must be equal cannot go on from an event inside a step:
    it is stepped without Event Mode, with a warning.
    """
    problems: list[Problem] = []
    warnings: list[str] = []
    if varies:
        read = "together with a variable communication step"
        problems.append(Problem("events", read, "one of them"))
    jacobi = {i for g in plan.groups if g.algorithm == "jacobi" for i in g.members}
    group: dict[int, int] = {}  # component -> the first of its group
    for i, c in enumerate(plan.components):
        if not c.description.has_event_mode:
            continue
        if not c.description.can_handle_variable_step:
            warnings.append(
                f"events: {c.path} has Event Mode, but cannot handle a variable communication "
                "step; it is stepped without Event Mode"
            )
        elif i not in jacobi:
            read = "it has Event Mode, and steps in a Gauss-Seidel or iterated group"
            expected = (
                "a component outside of these groups (--loops delay), or a run without events"
            )
            problems.append(Problem(f"events: {c.path}", read, expected))
        else:
            group[i] = i
    if problems:
        raise SystemInvalid(problems)
    if not group:
        warnings.append("events: no component is an FMU of FMI 3.0 with Event Mode")
    for t in (*plan.transfers, *plan.clocks):
        a, b = group.get(t.source), group.get(t.target)
        steps = {plan.components[i].step_ticks for i in (t.source, t.target)}
        if a is None or b is None or a == b:
            continue
        if len(steps) == 1:
            group = {i: min(a, b) if n in (a, b) else n for i, n in group.items()}
        else:
            warnings.append(
                f"events: {plan.hop(t)} joins components with unequal communication steps, so that "
                "its value changes at communication points only"
            )
    members = (
        tuple(i for i, n in group.items() if n == first) for first in sorted({*group.values()})
    )
    warnings = list(dict.fromkeys([*warnings, *clock_notes(plan)]))
    return replace(plan, events=tuple(members), warnings=(*plan.warnings, *warnings))
