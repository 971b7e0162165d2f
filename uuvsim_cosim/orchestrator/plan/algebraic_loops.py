"""Algebraic loops of a plan: their gain, and the policy that iterates, refuses or delays them.

A loop is algebraic if every hop declares its direct feedthrough. Stepped by Jacobi or
Gauss-Seidel, some of its connections delay by a step; this changes the system, which diverges if
the loop's gain is above one. A loop with an undeclared hop may have no feedthrough at all: it is
delayed, and a warning names it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.plan.graphs import shortest_cycle, strongly_connected
from uuvsim_cosim.orchestrator.plan.initial_loop import feedthrough, is_singular
from uuvsim_cosim.orchestrator.plan.initialization import Output, waits_of
from uuvsim_cosim.orchestrator.plan.plan import (
    AlgebraicLoop,
    Group,
    Plan,
    PlannedComponent,
    Transfer,
)
from uuvsim_cosim.orchestrator.plan.start import enter_initialization
from uuvsim_cosim.orchestrator.system.elements import step_text
from uuvsim_cosim.orchestrator.system.resolve import resolve

__all__ = [
    "LoopGain",
    "apply_loop_policy",
    "check_loops",
    "delay_remark",
    "estimated_gain",
    "found_loops",
    "gain_text",
    "hops_of",
    "iteration_obstacles",
    "loop_gain",
    "loop_lines_of",
]

_DELAY = '--loops delay (loops="delay")'
_FILTER = "a component with a state (for example a filter) in the loop"


def apply_loop_policy(plan: Plan, ungrouped: frozenset[int]) -> Plan:
    """Return the plan with its algebraic loops treated by its policy `loops`.

    `ungrouped` are the components that the user has put into no group. Raises SystemInvalid that
    lists the refused loops: by the policy, or because their members cannot be iterated.
    """
    # Groups that an OSP file made: sums, then the component that they feed. No user chose their
    # order, so the policy may change it.
    sums = {
        n
        for n, g in enumerate(plan.groups)
        if g.algorithm == "gauss-seidel"
        and len(g.members) > 1
        and all(plan.components[i].source.startswith("function:") for i in g.members[:-1])
    }
    free = sums | {n for n, g in enumerate(plan.groups) if ungrouped.issuperset(g.members)}
    group_of = {i: n for n, g in enumerate(plan.groups) for i in g.members}
    together: list[set[int]] = []  # disjoint sets of members to iterate
    problems: list[Problem] = []
    found = found_loops(plan)
    for loop in found:
        groups = {group_of[i] for i in loop.members}
        if loop.undeclared or plan.loops == "delay" or _is_iterated(plan.groups, loop):
            continue
        chosen = len(groups) == 1 and not groups & free
        if plan.loops == "iterate" and chosen:
            continue
        # A sum steps together with the component that it feeds: both join the group.
        members = {*loop.members, *(i for n in groups & sums for i in plan.groups[n].members)}
        reasons = list(_refusal_reasons(plan, loop, sorted(members), groups <= free))
        if reasons:
            problems.append(_refusal(plan, loop, reasons))
        # Sets that share a member with this one are merged with it.
        apart = [s for s in together if not s & members]
        together = [*apart, members.union(*(s for s in together if s & members))]
    if problems:
        raise SystemInvalid(problems)
    iterated = {i for members in together for i in members}
    rest = (
        replace(g, members=tuple(i for i in g.members if i not in iterated)) for g in plan.groups
    )
    groups_now = (
        *(g for g in rest if g.members),
        *(Group("iterated", tuple(sorted(members))) for members in together),
    )
    loops = tuple(replace(x, iterated=_is_iterated(groups_now, x)) for x in found)
    plan = replace(plan, groups=groups_now, algebraic_loops=loops)
    delayed = [line for x, line in zip(loops, loop_lines_of(plan), strict=True) if not x.iterated]
    return replace(plan, warnings=(*plan.warnings, *delayed))


def check_loops(plan: Plan) -> Plan:
    """Return a plan with its loops searched again, after a component was replaced; groups stay.

    Raises SystemInvalid for a loop that the policy does not allow to delay.
    """
    before = {x.members for x in plan.algebraic_loops if not x.iterated}
    found = [replace(x, iterated=_is_iterated(plan.groups, x)) for x in found_loops(plan)]
    problems = [
        _refusal(plan, x, [("no iterated group solves it", "a component without the feedthrough")])
        for x in found
        if not (x.iterated or x.undeclared or plan.loops == "delay" or x.members in before)
    ]
    for group in plan.groups:
        if group.algorithm == "iterated":
            members = [plan.components[i] for i in group.members]
            place = f"iterated group of {', '.join(c.path for c in members)}"
            problems += [Problem(place, *o) for o in iteration_obstacles(members, plan.tick)]
    if problems:
        raise SystemInvalid(problems)
    return replace(plan, algebraic_loops=tuple(found))


def found_loops(plan: Plan) -> list[AlgebraicLoop]:
    """Return the loops whose hops are all declared, then those with undeclared hops."""
    found = []
    for declared_only in (True, False):
        waits = waits_of(plan.components, plan.transfers, declared_only=declared_only)
        for block in strongly_connected(waits):
            silent = [n for n in block if _dependencies(plan, n) is None]
            cyclic = len(block) > 1 or block[0] in waits[block[0]]
            if cyclic and (declared_only or silent):
                found.append(_loop(plan, block, waits, silent))
    return found


def hops_of(plan: Plan, loop: AlgebraicLoop) -> str:
    """Name one way around a loop, connection by connection."""
    return ", ".join(plan.hop(plan.transfers[k]) for k in loop.cycle)


def loop_lines_of(plan: Plan) -> list[str]:
    """Return one sentence for each algebraic loop of a plan: how it is treated, and its hops."""
    lines = []
    for loop in plan.algebraic_loops:
        hops = hops_of(plan, loop)
        if loop.iterated:
            lines.append(f"algebraic loop, iterated at each communication point: {hops}")
        elif loop.undeclared:
            lines.append(
                "loop delayed by a step for each connection, and iterated in initialization, "
                f"because feedthrough is not declared ({', '.join(loop.undeclared)}): {hops}"
            )
        else:
            why = f'by the loop policy "{plan.loops}"' if plan.loops == "delay" else "by its group"
            lines.append(
                f"algebraic loop, delayed by a step for each connection, {why}, and solved in "
                f"initialization: {hops}"
            )
    return lines


def iteration_obstacles(
    members: Sequence[PlannedComponent], tick: Fraction
) -> Iterator[tuple[str, str]]:
    """Yield the reasons why components cannot be iterated: what was read, what is expected."""
    for c in members:
        if not c.description.can_get_and_set_state:
            yield (
                f"{c.path} cannot get and set its state",
                "components that can, because a step is repeated from the state at its start",
            )
    steps = {c.step_ticks: c.path for c in members}
    if len(steps) > 1:
        (a, first), (b, second) = list(steps.items())[:2]
        yield (
            f"{first} steps by {step_text(a * tick)} s, {second} by {step_text(b * tick)} s",
            "components of one communication step",
        )


# ---- inside ---------------------------------------------------------------------------------


def _refusal_reasons(
    plan: Plan, loop: AlgebraicLoop, members: Sequence[int], free: bool
) -> Iterator[tuple[str, str]]:
    """Yield the reasons why a loop is refused; `free`: no user has grouped its members."""
    components = [plan.components[i] for i in members]
    if plan.loops == "refuse":
        yield 'the loop policy is "refuse"', "--loops iterate"
        return
    if not free:
        yield (
            "some of its components are in a group, and others are not",
            f'one group of {", ".join(c.path for c in components)}, of algorithm "iterated"',
        )
    yield from iteration_obstacles(components, plan.tick)
    for k in loop.transfers:
        t = plan.transfers[k]
        if t.target_variable.type in ("String", "Binary"):
            yield f"{plan.hop(t)} carries text or bytes", "numbers in the loop"


def _refusal(plan: Plan, loop: AlgebraicLoop, why: Sequence[tuple[str, str]]) -> Problem:
    gain = gain_text(estimated_gain(plan, loop))
    return Problem(
        f"algebraic loop {hops_of(plan, loop)}",
        f"{gain}; it is refused, because {' and '.join(read for read, _ in why)}",
        ", ".join([*dict.fromkeys(expected for _, expected in why), _FILTER, f"or {_DELAY}"]),
    )


def _is_iterated(groups: Sequence[Group], loop: AlgebraicLoop) -> bool:
    members = set(loop.members)
    return any(g.algorithm == "iterated" and members <= set(g.members) for g in groups)


def _dependencies(plan: Plan, output: Output) -> tuple[str, ...] | None:
    component, name = output
    if not name:  # the event that all inputs are set
        return ()
    return plan.components[component].description.variables[name].dependencies


def _loop(
    plan: Plan,
    block: Sequence[Output],
    waits: Mapping[Output, Sequence[Output]],
    silent: Sequence[Output],
) -> AlgebraicLoop:
    """Return the loop of a strongly connected block; `silent` outputs declare no dependencies."""
    inside = {n: [w for w in waits[n] if w in block] for n in block}
    into: dict[Output, list[int]] = {}  # transfers within the block on which an output depends
    for n in block:
        declared = _dependencies(plan, n)
        into[n] = [
            k
            for k, t in enumerate(plan.transfers)
            if t.target == n[0]
            and _source(t) in block
            and (declared is None or t.target_variable.name in declared)
        ]
    begin = silent[0] if silent else min(block)
    backwards = shortest_cycle(inside, begin)  # waiting runs against the flow
    forwards = [backwards[0], *backwards[:0:-1]]
    hops = zip(forwards, [*forwards[1:], forwards[0]], strict=True)
    cycle = [next(k for k in into[b] if _source(plan.transfers[k]) == a) for a, b in hops]
    return AlgebraicLoop(
        members=tuple(sorted({c for c, _ in block})),
        transfers=tuple(sorted({k for ks in into.values() for k in ks})),
        cycle=tuple(cycle),
        undeclared=tuple(
            f"{path}.{name} -> {path}.{out}"
            for component, out in silent
            for path in [plan.components[component].path]
            for name in dict.fromkeys(
                plan.transfers[k].target_variable.name for k in into[component, out]
            )
        ),
    )


def _source(t: Transfer) -> Output:
    return t.source, t.source_variable.name


_REAL = 1e-9  # an imaginary part below it, relative to the magnitude, is rounding


@dataclass(frozen=True)
class LoopGain:
    """Gain of a loop: the change of one input after one way around the loop.

    With x the inputs inside the loop and G = d(new x)/dx, through the members' direct feedthrough
    and the connections, x = G x + b has one solution if I - G is regular. A loop whose connections
    delay by a step follows x_k+1 = G x_k + b, which diverges if an eigenvalue of G exceeds 1.
    """

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
