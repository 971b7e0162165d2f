"""Validation of a system: it finds all problems, and brings the system's parts into normal form.

In the normal form, values have the shape and unit of their variable, slices are written element by
element, and elements that together are a whole connector are written as that connector.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import get_args

from uuvsim_cosim.errors import InputInvalid, Problem, UuvsimError
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.system.elements import (
    Algorithm,
    Connection,
    Element,
    Exposed,
    Loops,
    Mismatches,
    Solver,
    Structure,
    step_text,
)
from uuvsim_cosim.orchestrator.system.resolve import described_by
from uuvsim_cosim.orchestrator.system.versions import Versions
from uuvsim_cosim.orchestrator.system.wiring import Wire, joined, single_source, wire
from uuvsim_cosim.orchestrator.values.endpoints import (
    Endpoint,
    find_variable,
    resolve_endpoint,
)
from uuvsim_cosim.orchestrator.values.values import Misfit, fit, flat

__all__ = [
    "Checked",
    "as_step",
    "check",
    "describe_element",
    "problem_of",
    "with_connection",
    "with_element",
    "with_start",
]

_FORBIDDEN = set("[]/\\")


@dataclass(frozen=True)
class Checked:
    """Parts of a system in normal form, with every problem and the notes for the user."""

    elements: tuple[Element, ...]
    wires: tuple[Wire, ...]
    exposed: tuple[Exposed, ...]
    descriptions: Versions[str, Description]  # in the order of the elements
    fed: Versions[
        tuple[str, str, int], None
    ]  # inputs with a source: element, variable, its element
    problems: tuple[Problem, ...]
    notes: tuple[str, ...]


def problem_of(place: str, error: UuvsimError) -> Problem:
    """Return an error that has been raised elsewhere as a problem at a place."""
    return error.at(place, "a source that can be read")


def as_step(value: Fraction | str | float, place: str) -> Fraction:
    """Read a step in s, exactly: 0.01, "1/60"; raises Misfit through InputInvalid."""
    try:
        step = Fraction(str(value).removesuffix("s").strip())
    except (ValueError, ZeroDivisionError):
        raise InputInvalid(place, f"step {value!r}", "seconds such as '0.01' or '1/60'") from None
    if step <= 0:
        raise InputInvalid(place, f"step of {value} s", "more than 0")
    return step


def describe_element(element: Element, base: Path | None) -> Description:
    """Return the description of an element's source, with the units that are assumed for it."""
    if isinstance(element.source, str):
        description = described_by(element.source, base, element.start).describe()
    else:
        description = element.source.interface()
    if not element.units:
        return description
    variables = dict(description.variables)
    for name, unit in element.units.items():
        if name in variables and None in variables[name].units:
            variables[name] = assumed(variables[name], unit)
    return replace(description, variables=variables)


def assumed(variable: Variable, units: str) -> Variable:
    """Return the variable with the assumed unit, or one unit for each of its elements."""
    each = tuple(units.split())
    if len(each) == 1:
        return replace(variable, unit=each[0])
    return replace(variable, element_units=each)


def check(system: Structure) -> Checked:
    """Check all that can be checked without a run; see the module's docstring."""
    problems: list[Problem] = []
    notes: list[str] = []
    descriptions: dict[str, Description] = {}
    seen: set[str] = set()
    for element in system.elements:
        name = element.name
        if name in seen:
            problems.append(Problem(name, "two components of this name", "one"))
        seen.add(name)
        if not _is_name(name):
            problems.append(Problem(repr(name), "not a name", "a name without [ ] / \\"))
        try:
            descriptions[name] = describe_element(element, system.base)
        except UuvsimError as error:
            problems.append(problem_of(name, error))
    elements = tuple(_element(e, system, descriptions, problems) for e in system.elements)
    names = {e.name for e in elements}
    unknown = names - set(descriptions)
    wires: list[Wire] = []
    for connection in system.connections:
        try:
            found = wire(connection, descriptions, unknown, notes)
        except Misfit as misfit:
            problems.append(misfit.at(f"{connection.source} -> {connection.target}"))
        else:
            wires.extend(found)
    exposed = _exposed(system.exposed, descriptions, unknown, problems)
    ends = [(e.name, p) for e, p in exposed if p]
    problems.extend(single_source(wires, ends))
    inputs = [p for _, p in ends if p.variable.causality == "input"]
    fed = _fed([*(w.target for w in wires), *inputs])
    _check_groups(system, names, problems)
    for element in elements:
        if element.units:
            shown = {n: ", ".join(dict.fromkeys(u.split())) for n, u in element.units.items()}
            listed = "; ".join(f"{n} in {u}" for n, u in shown.items())
            notes.append(f"{element.name}: no unit given; those of the slot are used: {listed}")
    return Checked(
        elements, joined(wires), _joined_exposed(exposed), Versions(descriptions), Versions(fed),
        tuple(problems), tuple(dict.fromkeys(notes)),
    )  # fmt: skip


def with_element(system: Structure, checked: Checked, element: Element) -> Checked | None:
    """Return what `check` returns for a valid system with one more element.

    Only the element is checked. None if that is not enough, or if there is a problem: then `check`
    finds all of them.
    """
    name = element.name
    # A name with a dot can give the texts of other connections another meaning.
    if not _is_name(name) or "." in name or name in checked.descriptions or element.units:
        return None
    try:
        described = {name: describe_element(element, system.base)}
    except UuvsimError:
        return None
    problems: list[Problem] = []
    element = _element(element, system, described, problems)
    if problems:
        return None
    return replace(
        checked,
        elements=checked.elements + (element,),  # noqa: RUF005  (one copy, where * makes two)
        descriptions=checked.descriptions.extended(described),
    )


def with_start(
    system: Structure, checked: Checked, name: str, key: str, value: object
) -> Checked | None:
    """Return what `check` returns for a valid system with another start value of one component.

    None if the value is no such thing, or changes more than itself: see `with_element`.
    """
    index = checked.descriptions.index(name)
    old = checked.elements[index]
    description = checked.descriptions[name]
    problems: list[Problem] = []
    element = _element(
        replace(old, start={**old.start, key: value}), system, {name: description}, problems
    )
    structural = any(
        description.variables[n].causality == "structuralParameter" for n in element.start
    )
    if problems or structural or not isinstance(old.source, str):
        return None
    before, after = checked.elements[:index], checked.elements[index + 1 :]
    return replace(checked, elements=before + (element,) + after)  # noqa: RUF005  (fewer copies)


def with_connection(checked: Checked, connection: Connection) -> Checked | None:
    """Return what `check` returns with one more connection; see `with_element`."""
    notes = list(checked.notes)
    try:
        new = wire(connection, checked.descriptions, set(), notes)
    except Misfit:
        return None
    fed = _fed(w.target for w in new)
    if len(fed) != sum(len(w.target.elements) for w in new) or any(f in checked.fed for f in fed):
        return None
    if not new[0].target.whole and new[0].source.variable.shape == new[0].target.variable.shape:
        return None  # elements that may complete a whole connector
    wires = checked.wires + tuple(new)
    return replace(checked, wires=wires, fed=checked.fed.extended(fed), notes=tuple(notes))


def _is_name(name: str) -> bool:
    return bool(name) and not _FORBIDDEN & set(name) and name.isprintable()


def _fed(points: Iterable[Endpoint]) -> dict[tuple[str, str, int], None]:
    return {(p.element, p.variable.name, i): None for p in points for i in p.elements}


def _element(
    element: Element,
    system: Structure,
    descriptions: Mapping[str, Description],
    problems: list[Problem],
) -> Element:
    """Return an element with its step and its start values in normal form."""
    rate = _rate(element, system.base_step, problems)
    if element.name not in descriptions:
        return replace(element, rate=rate)
    description = descriptions[element.name]
    start: dict[str, object] = {}
    parts: dict[str, dict[int, object]] = {}  # values of single elements of arrays
    for key, given in element.start.items():
        try:
            variable, elements, is_whole = find_variable(key, description)
            settable = variable.causality in ("parameter", "structuralParameter", "input")
            has_start = variable.initial in ("exact", "approx")
            if not settable and not (has_start and variable.variability != "constant"):
                raise Misfit(
                    f"{variable.name} is {_article(variable.causality)} without a settable start "
                    "value",
                    "a parameter or an input",
                )
            if is_whole:
                start[variable.name] = fit(variable, given, None, description.units)
                continue
            shape = () if len(elements) == 1 else (len(elements),)
            units = tuple(variable.unit_of_element(i) for i in elements)
            part = replace(
                variable,
                shape=shape,
                unit=units[0] if len(set(units)) == 1 else None,
                element_units=units if len(set(units)) > 1 else (),
            )
            value = fit(part, given, None, description.units)
            parts.setdefault(variable.name, {}).update(zip(elements, flat(value), strict=True))
        except Misfit as misfit:
            problems.append(misfit.at(f"{element.name}.{key}"))
    for name, values in parts.items():
        try:
            variable = description.variables[name]
            base = start.get(name, variable.start)
            if base is None and len(values) < variable.size:
                raise Misfit(
                    f"some elements of {variable.name}, which has no start value",
                    f"all {variable.size} elements",
                )
            whole = dict(enumerate(flat(base))) if base is not None else {}
            start[name] = fit(variable, [(whole | values)[i] for i in range(variable.size)])
        except Misfit as misfit:
            problems.append(misfit.at(f"{element.name}.{name}"))
    return replace(element, rate=rate, start=start)


def _rate(element: Element, tick: Fraction, problems: list[Problem]) -> Fraction | None:
    if element.rate is None:
        return None
    try:
        rate = as_step(element.rate, element.name)
    except UuvsimError as error:
        problems.append(problem_of(element.name, error))
        return None
    if not isinstance(element.source, str):
        problems.append(
            Problem(element.name, "a step for a nested system", "steps on its components")
        )
    elif (rate / tick).denominator != 1:
        low = max(rate // tick, 1) * tick
        choices = " or ".join(dict.fromkeys(step_text(c) for c in (low, low + tick)))
        problems.append(
            Problem(
                element.name,
                f"a communication step of {step_text(rate)} s, which the system's tick of "
                f"{step_text(tick)} s does not divide",
                f"a whole multiple of {step_text(tick)} s such as {choices}",
            )
        )
    return rate


def _article(word: str) -> str:
    return f"an {word}" if word[0] in "aeio" else f"a {word}"


def _exposed(
    exposed: tuple[Exposed, ...],
    descriptions: Mapping[str, Description],
    unknown: set[str],
    problems: list[Problem],
) -> list[tuple[Exposed, Endpoint | None]]:
    """Return the valid exposed connectors, with the endpoints inside that they expose."""
    result: list[tuple[Exposed, Endpoint | None]] = []
    outputs: set[str] = set()
    causalities: dict[str, set[str]] = {}
    for item in exposed:
        place = f"exposed connector {item.name!r}"
        try:
            if item.path.partition(".")[0] in unknown:
                continue
            point = resolve_endpoint(item.path, descriptions)
            causality = point.variable.causality
            if causality not in ("input", "output", "parameter"):
                raise Misfit(f"{item.path} is {_article(causality)}", "an input or output")
            if causality == "output" and item.name in outputs:
                raise Misfit("two outputs", "one")
            if "." in item.name:
                raise Misfit("a dot in its name", "a name without dots")
        except Misfit as misfit:
            problems.append(misfit.at(place))
            continue
        outputs.add(item.name)
        causalities.setdefault(item.name, set()).add(causality)
        if len(causalities[item.name]) > 1:
            problems.append(Problem(place, "both an input and an output", "one of the two"))
        result.append((item, point))
    return result


def _joined_exposed(exposed: list[tuple[Exposed, Endpoint | None]]) -> tuple[Exposed, ...]:
    """Write ``x[1] … x[n]`` that expose ``a.y[1] … a.y[n]`` as ``x`` that exposes ``a.y``."""
    by_whole: dict[tuple[str, str], dict[str, Exposed]] = {}
    for item, point in exposed:
        if point is not None and not point.whole and item.name.endswith("]"):
            key = (item.name.rpartition("[")[0], f"{point.element}.{point.variable.name}")
            if item.name.rpartition("[")[2] == item.path.rpartition("[")[2]:
                by_whole.setdefault(key, {})[item.path] = item
    result: dict[Exposed, None] = {}
    for item, point in exposed:
        whole = item
        if point is not None and not point.whole:
            key = (item.name.rpartition("[")[0], f"{point.element}.{point.variable.name}")
            if len(by_whole.get(key, {})) == point.variable.size:
                whole = Exposed(*key)
        result[whole] = None
    return tuple(result)


def _check_groups(system: Structure, names: set[str], problems: list[Problem]) -> None:
    grouped: set[str] = set()
    if system.loops not in get_args(Loops):
        policies = "iterate, refuse or delay"
        problems.append(Problem(system.name, f"loop policy {system.loops!r}", policies))
    if system.mismatches not in get_args(Mismatches):
        read = f"policy for mismatches {system.mismatches!r}"
        problems.append(Problem(system.name, read, "refuse or warn"))
    for group in system.groups:
        place = f"group of {', '.join(group.members)}"
        for what, read, known in (
            ("algorithm", group.algorithm, get_args(Algorithm)),
            ("solver", group.solver, get_args(Solver)),
        ):
            if read not in known:
                near = expected_names(read, list(known), "one of " + ", ".join(map(repr, known)))
                problems.append(Problem(place, f"{what} {read!r}", near))
        numbers = isinstance(group.tolerance, int | float) and isinstance(group.limit, int)
        if not (numbers and 0.0 < group.tolerance < 1.0 and group.limit >= 1):
            problems.append(
                Problem(
                    place,
                    f"tolerance {group.tolerance}, limit {group.limit}",
                    "a tolerance between 0 and 1, and at least one iteration",
                )
            )
        for member in group.members:
            if member not in names:
                problems.append(
                    Problem(
                        place, f"no component {member!r}",
                        expected_names(member, sorted(names), "the name of a component"),
                    )
                )  # fmt: skip
            elif member in grouped:
                problems.append(Problem(place, f"{member!r} in two groups", "at most one"))
            grouped.add(member)
