"""Wires of a connection: checked pairs of elements, with the conversion between them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from uuvsim_cosim.errors import Problem
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.models.declaration.element_names import index_text
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.system.elements import Connection
from uuvsim_cosim.orchestrator.values.endpoints import (
    Endpoint,
    find_element,
    resolve_endpoint,
)
from uuvsim_cosim.orchestrator.values.transformation import Numbers, numbers_of
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion, is_float, unit_named

__all__ = ["Wire", "joined", "single_source", "wire"]


@dataclass(frozen=True)
class Wire:
    """A connection whose ends are known, either whole connectors or one element each."""

    connection: Connection
    source: Endpoint
    target: Endpoint
    changes: tuple[tuple[float, float], ...]  # (factor, offset) of each pair of elements
    table: Numbers = ()  # instead of them


def wire(
    connection: Connection,
    descriptions: Mapping[str, Description],
    unknown: set[str],
    notes: list[str],
) -> list[Wire]:
    """Check one connection; return one wire if it is whole, else one for each element.

    A connection of an `unknown` component has no wires. Raises Misfit.
    """
    if unknown:
        names = {**descriptions, **dict.fromkeys(unknown, None)}
        if any(
            find_element(e, names)[0] in unknown for e in (connection.source, connection.target)
        ):
            return []
    source = resolve_endpoint(connection.source, descriptions)
    target = resolve_endpoint(connection.target, descriptions)
    _check_ends(source, target)
    c = connection
    if c.table and (c.factor, c.offset) != (1.0, 0.0):
        raise Misfit("a table, and a factor or offset", "one of the two")
    table = numbers_of(c.table, source.variable, target.variable) if c.table else ()
    units = {**descriptions[source.element].units, **descriptions[target.element].units}
    changes: list[tuple[float, float]] = [(1.0, 0.0)] * len(source.elements)
    if c.convert and is_float(source.variable) and is_float(target.variable):
        changes = _conversions(source, target, units, notes)
    changes = [(c.factor * factor, c.factor * offset + c.offset) for factor, offset in changes]
    if source.whole and target.whole:
        return [Wire(connection, source, target, tuple(changes), table)]
    return [
        Wire(
            replace(connection, source=a, target=b),
            Endpoint(source.element, source.variable, (i,), source.variable.shape == ()),
            Endpoint(target.element, target.variable, (j,), target.variable.shape == ()),
            (change,),
            table,
        )
        for a, b, i, j, change in zip(
            source.texts(), target.texts(), source.elements, target.elements, changes, strict=True
        )
    ]


def joined(wires: Iterable[Wire]) -> tuple[Wire, ...]:
    """Write wires that together join two whole connectors, element by element, as one."""
    wires = list(wires)
    parts: dict[tuple[object, ...], dict[int, int]] = {}
    changes: dict[tuple[object, ...], dict[int, tuple[float, float]]] = {}
    for w in wires:
        if len(w.source.elements) == 1 and len(w.target.elements) == 1:
            parts.setdefault(_pair(w), {})[w.target.elements[0]] = w.source.elements[0]
            changes.setdefault(_pair(w), {})[w.target.elements[0]] = w.changes[0]
    result: dict[Connection, Wire] = {}
    for w in wires:
        source, target = w.source.variable, w.target.variable
        complete = source.shape == target.shape and parts.get(_pair(w)) == {
            i: i for i in range(target.size)
        }
        if complete:
            c = w.connection
            whole = Connection(
                f"{w.source.element}.{source.name}", f"{w.target.element}.{target.name}",
                c.factor, c.offset, c.convert, c.table,
            )  # fmt: skip
            every = tuple(range(source.size))
            w = Wire(
                whole,
                Endpoint(w.source.element, source, every, whole=True),
                Endpoint(w.target.element, target, every, whole=True),
                tuple(changes[_pair(w)][i] for i in every),
                w.table,
            )
        result.setdefault(w.connection, w)
    return tuple(result.values())


def single_source(wires: Iterable[Wire], exposed: Iterable[tuple[str, Endpoint]]) -> list[Problem]:
    """Find the inputs with two sources."""
    feeds = [(w.connection.source, w.target) for w in wires]
    feeds += [
        (f"exposed connector {name!r}", point)
        for name, point in exposed
        if point.variable.causality == "input"
    ]
    first: dict[tuple[str, str, int], str] = {}  # the first source of each element
    doubled: dict[tuple[str, str], list[str]] = {}
    for source, target in feeds:
        element, name = target.element, target.variable.name
        clashes = [first[element, name, i] for i in target.elements if (element, name, i) in first]
        if clashes:
            doubled.setdefault((element, name), clashes[:1]).append(source)
        for i in target.elements:
            first.setdefault((element, name, i), source)
    return [
        Problem(f"{element}.{name}", f"{len(froms)} sources, {' and '.join(froms)}", "one")
        for (element, name), froms in doubled.items()
    ]


def _pair(w: Wire) -> tuple[object, ...]:
    """Return a key of the wires that may be elements of one connection."""
    return (
        w.source.element, w.source.variable.name, w.target.element, w.target.variable.name,
        w.connection.factor, w.connection.offset, w.connection.convert,
        w.connection.table,
    )  # fmt: skip


def _check_ends(source: Endpoint, target: Endpoint) -> None:
    """Check causality, sizes and types of a connection's ends; raises Misfit."""
    a, b = source.variable, target.variable
    if a.type == b.type == "Clock":
        _check_clocks(source, target)
        return
    if a.causality == "input" and b.causality == "output":
        raise Misfit("from an input to an output", "the other way round, output to input")
    if a.causality != "output":
        raise Misfit(
            f"{source.element}.{a.name} at its start, of causality {a.causality}", "an output"
        )
    if b.causality != "input":
        raise Misfit(
            f"{target.element}.{b.name} at its end, of causality {b.causality}", "an input"
        )
    count = len(source.elements)
    if count != len(target.elements):
        raise Misfit(f"{_size(source)} to {_size(target)}", "equal sizes")
    if source.whole and target.whole and count > 1 and a.shape != b.shape:
        raise Misfit(f"shape {a.shape} to shape {b.shape}", "equal shapes")
    to_float = is_float(b) and a.type not in ("String", "Binary", "Clock")
    both_whole = all("Int" in v.type or v.type == "Enumeration" for v in (a, b))
    if a.type != b.type and not to_float and not both_whole:
        raise Misfit(f"type {a.type} to type {b.type}", "equal types")


def _check_clocks(source: Endpoint, target: Endpoint) -> None:
    """Check a connection of clocks; raises Misfit.

    The master activates time-based clocks itself, also those of inputs, so that each of them can be
    a source. Only a triggered input clock can be a target.
    """
    a, b = source.variable, target.variable
    assert a.timing is not None
    assert b.timing is not None
    if a.causality != "output" and not (a.causality == "input" and a.timing.is_time_based):
        raise Misfit(
            f"from the {a.timing.variability} {a.causality} clock {source.element}.{a.name}",
            "an output clock, or a time-based input clock",
        )
    if b.causality != "input" or b.timing.is_time_based:
        raise Misfit(
            f"to the {b.timing.variability} {b.causality} clock {target.element}.{b.name}, which "
            "does not tick with another clock",
            "a triggered input clock",
        )


def _size(point: Endpoint) -> str:
    count = len(point.elements)
    return "a scalar" if point.variable.shape == () else f"{count} element{'s' * (count != 1)}"


def _conversions(
    source: Endpoint, target: Endpoint, units: Mapping[str, Unit], notes: list[str]
) -> list[tuple[float, float]]:
    """Return (factor, offset) of each pair of elements, by their units; note assumed units."""
    changes: list[tuple[float, float]] = []
    for i, j in zip(source.elements, target.elements, strict=True):
        a, b = source.variable.unit_of_element(i), target.variable.unit_of_element(j)
        if a is None or b is None:
            if a is not None or b is not None:
                bare, other = (source, target) if a is None else (target, source)
                unit = other.variable.unit_text if len(other.elements) > 1 else a or b
                note = (
                    f"{bare.element}.{bare.variable.name}: no unit given; "
                    f"{unit} is used, that of {other.element}.{other.variable.name}"
                )
                if note not in notes:
                    notes.append(note)
            changes.append((1.0, 0.0))
            continue
        pair = conversion(a, b, units)
        if pair is None:
            read = f"unit {a!r} to unit {b!r}"
            if len(source.elements) > 1 and (
                source.variable.element_units or target.variable.element_units
            ):
                read = f"element {index_text(target.variable.shape, j) or j + 1}: {read}"
            strange = [u for u in (a, b) if unit_named(u, units) is None]
            if strange:
                read += f", where {' and '.join(repr(u) for u in strange)} is unknown"
            raise Misfit(read, "equal or commensurable units")
        changes.append(pair)
    return changes
