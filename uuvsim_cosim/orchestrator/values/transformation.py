"""Transformation of a value by a connection or a mapping: unit, factor and offset, or a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element as Xml
from xml.etree.ElementTree import SubElement

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion
from uuvsim_cosim.orchestrator.values.xml_values import (
    BOOLEANS,
    boolean,
    float_of,
    local_name,
    text_of,
)

__all__ = [
    "PLAIN",
    "Numbers",
    "Table",
    "Transformation",
    "add_table",
    "chained",
    "listed",
    "map_value",
    "numbers_of",
    "read_table",
    "read_transformation",
    "table_of",
]

Table = tuple[tuple[bool | int | str, bool | int | str], ...]
Numbers = tuple[tuple[int, int], ...]  # a table in the form of the stepping loop in C
_TYPES: dict[str, type[bool | int | str]] = {"Boolean": bool, "Integer": int, "Enumeration": str}
_EXPECTED: dict[type, str] = {
    bool: "true or false",
    int: "a whole number",
    str: "the name of an item",
}


def table_of(values: Mapping[Any, bool | int | str], place: str) -> Table:
    """Return a table of Booleans, of integers or of names of items; raises InputInvalid."""
    table = tuple(values.items())
    types = {type(v) for pair in table for v in pair}
    if len(types) != 1 or not types <= set(_EXPECTED):
        raise InputInvalid(
            place,
            f"a table of {', '.join(sorted(t.__name__ for t in types)) or 'no values'}",
            "Booleans, integers, or names of items, on both sides",
        )
    return table


def read_table(xml: Xml, tag: str, place: str) -> Table:
    """Read a ``ssc:BooleanMappingTransformation``, or one of integers or of enumerations' items.

    Raises InputInvalid.
    """
    type_ = _TYPES[tag.removesuffix("MappingTransformation")]

    def read(entry: Xml, side: str) -> bool | int | str:
        text = entry.get(side)
        try:
            if text is not None:
                return BOOLEANS[text.strip()] if type_ is bool else type_(text)
        except (ValueError, KeyError):
            pass
        read = f"<ssc:MapEntry> with {side} {text!r}"
        raise InputInvalid(f"{place}: {tag}", read, _EXPECTED[type_])

    found: dict[bool | int | str, bool | int | str] = {}
    for entry in xml:
        if not (isinstance(entry.tag, str) and entry.tag.endswith("}MapEntry")):
            continue
        source, target = (read(entry, side) for side in ("source", "target"))
        if found.setdefault(source, target) != target:
            raise InputInvalid(
                place,
                (
                    f"{tag}: {text_of(source)!r} becomes {text_of(found[source])!r} and "
                    f"{text_of(target)!r}"
                ),
                "one entry a source",
            )
    if not found:
        raise InputInvalid(place, f"a {tag} without entries", "<ssc:MapEntry …>")
    return tuple(found.items())


def add_table(parent: Xml, table: Table) -> None:
    """Write a table into a connection."""
    type_name = next(name for name, type_ in _TYPES.items() if type(table[0][0]) is type_)
    xml = SubElement(parent, f"ssc:{type_name}MappingTransformation")
    for source, target in table:
        SubElement(xml, "ssc:MapEntry", source=text_of(source), target=text_of(target))


def map_value(table: Table, value: object, place: str) -> Any:
    """Map a parameter's value by the table, a list element by element; raises InputInvalid."""
    if isinstance(value, list | tuple):
        return [map_value(table, v, place) for v in value]
    wanted = type(table[0][0])
    key = getattr(value, "item", value) if wanted is str else value  # an EnumerationItem's name
    if not isinstance(key, wanted) or (wanted is not bool and isinstance(key, bool)):
        raise InputInvalid(f"{place} is {value!r}", f"{_EXPECTED[wanted]}, which is mapped")
    found = dict(table)
    if key not in found:
        expected = listed(table)
        if isinstance(key, str):
            expected = expected_names(key, [str(k) for k in found], expected)
        raise InputInvalid(f"{place} is {text_of(key)!r}, which has no entry", expected)
    return found[key]


def listed(table: Sequence[tuple[object, object]]) -> str:
    """Return the sources of a table as a text for an error message."""
    return "one of " + ", ".join(text_of(source) for source, _ in table)


def numbers_of(table: Table, source: Variable, target: Variable) -> Numbers:
    """Return a table as numbers of both variables' types; raises Misfit."""
    type_ = type(table[0][0])
    for v in (source, target):
        if type_ is bool:
            right = v.type == "Boolean"
        else:
            right = v.type == "Enumeration" or (type_ is int and "Int" in v.type)
        if not right:
            kinds = {bool: "Boolean", int: "an integer type or Enumeration", str: "Enumeration"}
            words = {bool: "Booleans", int: "integers", str: "names of items"}[type_]
            raise Misfit(f"a table of {words} at {v.name} of type {v.type}", f"type {kinds[type_]}")
    if type_ is not str:
        return tuple((int(a), int(b)) for a, b in table)
    return tuple((_item(source, str(a)), _item(target, str(b))) for a, b in table)


def _item(variable: Variable, name: str) -> int:
    numbers = dict(variable.items)
    if name not in numbers:
        raise Misfit(
            f"item {name!r} of {variable.name} in a table",
            expected_names(name, list(numbers), "an item of its enumeration"),
        )
    return int(numbers[name])


@dataclass(frozen=True)
class Transformation:
    """The target gets factor · value + offset, after conversion into its unit if `convert`."""

    factor: float = 1.0
    offset: float = 0.0
    convert: bool = True
    table: Table = ()

    @property
    def scales(self) -> bool:
        """Return whether there is a factor or an offset."""
        return (self.factor, self.offset) != (1.0, 0.0)


PLAIN = Transformation()
_TABLES = [f"{kind}MappingTransformation" for kind in ("Boolean", "Integer", "Enumeration")]


def read_transformation(xml: Xml, place: str) -> Transformation:
    """Read the transformation of a connection or of a mapping's entry; raises InputInvalid."""
    convert = not boolean(xml.get("suppressUnitConversion"))
    for child in xml:
        tag = local_name(child)
        if tag == "LinearTransformation":
            factor = float_of(child, "factor", place, 1.0)
            return Transformation(factor, float_of(child, "offset", place, 0.0), convert)
        if tag in _TABLES:
            return Transformation(convert=convert, table=read_table(child, tag, place))
        if tag.endswith("Transformation"):
            raise InputInvalid(
                place,
                f"a {tag}",
                f"none, or one of {', '.join(['LinearTransformation', *_TABLES])}",
            )
    return Transformation(convert=convert)


def chained(
    first: Transformation,
    second: Transformation,
    units: tuple[str | None, str | None, str | None],
    definitions: Mapping[str, Unit],
) -> Transformation:
    """Return the transformation that applies two in turn.

    `units` are those at the start, between the two, and at the end; None if not known. Raises
    Misfit for units that are not commensurable, and for a table together with a factor or offset.
    """
    if first.table and second.table:
        last = dict(second.table)
        both = tuple((a, last[b]) for a, b in first.table if b in last)
        if not both:
            raise Misfit("two tables on one connection; the second has no entry for any value of "
            "the first", "entries that fit")  # fmt: skip
        return Transformation(table=both)
    if first.table or second.table:
        if first.scales or second.scales:
            raise Misfit("a table, and a factor or offset, on one connection", "one of the two")
        return first if first.table else second
    start, middle, end = units
    if middle is None:  # the value between has the unit that it came with
        middle = start
    if not first.scales and first.convert and second.convert:
        known = start is None or middle is None or conversion(start, middle, definitions)
        if known is not None:
            return second
    factor, offset = 1.0, 0.0
    for step, a, b in ((first, start, middle), (second, middle, end)):
        if step.convert and a is not None and b is not None:
            pair = conversion(a, b, definitions)
            if pair is None:
                raise Misfit(f"unit {a!r} to unit {b!r}", "equal or commensurable units")
            factor, offset = factor * pair[0], offset * pair[0] + pair[1]
        factor, offset = factor * step.factor, offset * step.factor + step.offset
    return Transformation(factor, offset, convert=False)
