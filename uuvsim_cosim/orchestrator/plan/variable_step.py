"""Plan of a variable communication step: lengths in ticks, and the values that choose them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.plan.plan import (
    Group,
    PlannedBond,
    PlannedComponent,
    PlannedVariableStep,
    Transfer,
)
from uuvsim_cosim.orchestrator.system.elements import step_text
from uuvsim_cosim.orchestrator.system.variable_step import VariableStep
from uuvsim_cosim.orchestrator.values.endpoints import find_variable
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = ["planned_variable_step"]

_PLACE = "variable step"


def planned_variable_step(
    step: VariableStep,
    tick: Fraction,
    components: Sequence[PlannedComponent],
    transfers: Sequence[Transfer],
    groups: Sequence[Group],
) -> PlannedVariableStep:
    """Return the plan of a variable step; raises SystemInvalid with every problem.

    The components whose communication step is the tick follow it. All others keep their own.
    """
    problems: list[Problem] = []
    lengths = {"smallest": step.smallest, "largest": step.largest, "first": step.beginning}
    ticks = {name: length / tick for name, length in lengths.items()}
    for name, n in ticks.items():
        if n.denominator != 1 and not (name == "first" and step.first is None):
            problems.append(
                Problem(
                    _PLACE,
                    f"{name} {step_text(lengths[name])} s is no multiple of the tick of "
                    f"{step_text(tick)} s",
                    "a multiple, or a smaller tick (tick=1e-6)",
                )
            )
    for c in components:
        if c.step_ticks != 1:
            continue
        if not c.description.can_handle_variable_step:
            problems.append(
                Problem(
                    f"{_PLACE}: {c.path}",
                    "it declares that it cannot handle a variable communication step",
                    "a communication step of its own (--rate, rate=)",
                )
            )
        if step.rollback and not c.description.can_get_and_set_state:
            problems.append(
                Problem(
                    f"{_PLACE}: {c.path}",
                    "it cannot restore its state, which repeating a step needs",
                    "rollback=no, or a communication step of its own",
                )
            )
    judged = tuple(_judged(step, components, transfers, groups, problems))
    bonds = tuple(_bonds(step, components, transfers, problems))
    by_connections, by_bonds = step.estimate != "bonds", step.estimate != "connections"
    if by_bonds and not bonds:
        problems.append(Problem(_PLACE, "no power bond", "one, or estimate=connections"))
    if by_connections and not judged:
        problems.append(
            Problem(
                _PLACE,
                "no delayed connection of continuous Float64 values between components that "
                "follow it, so that nothing chooses its length",
                "one, or a fixed step",
            )
        )
    if problems:
        raise SystemInvalid(problems)
    return PlannedVariableStep(
        step=step,
        smallest=int(ticks["smallest"]),
        largest=int(ticks["largest"]),
        first=int(ticks["first"]),
        judged=judged if by_connections else (),
        extrapolated=tuple(dict.fromkeys(n for n, _, _ in judged)) if step.order else (),
        bonds=bonds if by_bonds else (),
    )


def _judged(
    step: VariableStep,
    components: Sequence[PlannedComponent],
    transfers: Sequence[Transfer],
    groups: Sequence[Group],
    problems: list[Problem],
) -> Iterator[tuple[int, float, float]]:
    """Yield (transfer, absolute, relative) of delayed connections.

    They are those of continuous numbers, and those that have tolerances of their own.
    """
    group_of = {i: g for g in groups for i in g.members}
    own = {name: (absolute, relative) for name, absolute, relative in step.tolerances}
    known: list[str] = []
    for n, t in enumerate(transfers):
        same = group_of[t.source] is group_of[t.target]
        group = group_of[t.source]
        early = same and (
            group.algorithm == "iterated"
            or (
                group.algorithm == "gauss-seidel"
                and group.members.index(t.source) < group.members.index(t.target)
            )
        )
        ends = components[t.source], components[t.target]
        if early or t.table or any(c.step_ticks != 1 for c in ends):
            continue
        if not t.source_variable.type == t.target_variable.type == "Float64":
            continue
        name = f"{ends[1].path}.{t.target_variable.name}"
        known.append(name)
        if t.source_variable.variability != "continuous" and name not in own:
            continue
        yield n, *own.get(name, (step.absolute, step.relative))
    for name in own.keys() - set(known):
        expected = expected_names(name, known, "a connected input that the step is chosen by")
        problems.append(Problem(f"{_PLACE}: tolerances", f"no connection to {name!r}", expected))


def _bonds(
    step: VariableStep,
    components: Sequence[PlannedComponent],
    transfers: Sequence[Transfer],
    problems: list[Problem],
) -> Iterator[PlannedBond]:
    index = {c.path: i for i, c in enumerate(components)}
    for bond in step.bonds:
        ends: list[tuple[int, str, int]] = []
        place = f"{_PLACE}: power bond {bond.name!r}"
        for side in (bond.first, bond.second):
            for text, causality in zip(side, ("input", "output"), strict=True):
                path = max((p for p in index if text.startswith(f"{p}.")), key=len, default="")
                if not path:
                    expected = expected_names(text.rpartition(".")[0], list(index), "a component")
                    problems.append(Problem(place, f"no component of {text!r}", expected))
                    continue
                description = components[index[path]].description
                try:
                    variable, elements, _ = find_variable(text[len(path) + 1 :], description)
                except Misfit as misfit:
                    problems.append(Problem(f"{place}, {path}", misfit.read, misfit.expected))
                    continue
                if variable.causality != causality or variable.type != "Float64":
                    read = f"{text} is an {variable.causality} of type {variable.type}"
                    problems.append(Problem(place, read, f"a Float64 {causality}"))
                elif len(elements) != 1:
                    read = f"{text} has {len(elements)} elements"
                    problems.append(Problem(place, read, f"one element, as {text}[1]"))
                else:
                    ends.append((index[path], variable.name, elements[0]))
        if len(ends) != 4:
            continue
        for source, target in ((ends[1], ends[2]), (ends[3], ends[0])):
            if not any(
                (t.source, t.source_variable.name, a) == source
                and (t.target, t.target_variable.name, b) == target
                for t in transfers
                for a, b in zip(t.source_elements, t.target_elements, strict=True)
            ):
                names = [f"{components[i].path}.{name}" for i, name, _ in (source, target)]
                read = f"{names[0]} is not connected to {names[1]}"
                problems.append(Problem(place, read, "each side's output at the other's input"))
        yield PlannedBond(bond.name, (ends[0], ends[1], ends[2], ends[3]))
