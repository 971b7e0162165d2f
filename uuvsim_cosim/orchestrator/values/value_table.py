"""Tables that map Booleans, integers or items of enumerations on a connection or mapping."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element as Xml
from xml.etree.ElementTree import SubElement

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.values.values import Misfit
from uuvsim_cosim.orchestrator.values.xml_values import text_of

__all__ = ["Numbers", "Table", "add_table", "chained_tables", "listed", "looked_up", "numbers_of",
           "read_table", "table_of"]  # fmt: skip

Table = tuple[tuple[bool | int | str, bool | int | str], ...]
Numbers = tuple[tuple[int, int], ...]  # a table as the stepping loop has it
_KINDS: dict[str, type] = {"Boolean": bool, "Integer": int, "Enumeration": str}
_EXPECTED = {bool: "true or false", int: "a whole number", str: "the name of an item"}


def table_of(values: Mapping[Any, Any], place: str) -> Table:
    """Return a table of Booleans, of integers or of names of items; raises InputInvalid."""
    table = tuple(values.items())
    kinds = {type(v) for pair in table for v in pair}
    if len(kinds) != 1 or not kinds <= set(_EXPECTED):
        raise InputInvalid(
            f"{place}: a table of {', '.join(sorted(k.__name__ for k in kinds)) or 'no values'}; "
            "expected Booleans, integers, or names of items, on both sides"
        )
    return table


def read_table(xml: Xml, tag: str, place: str) -> Table:
    """Read ``ssc:BooleanMappingTransformation`` and its like; raises InputInvalid."""
    type_ = _KINDS[tag.removesuffix("MappingTransformation")]
    found: dict[Any, Any] = {}
    for entry in xml:
        if not (isinstance(entry.tag, str) and entry.tag.endswith("}MapEntry")):
            continue
        source, target = (_value(entry, a, type_, f"{place}: {tag}") for a in ("source", "target"))
        if found.setdefault(source, target) != target:
            raise InputInvalid(
                f"{place}: {tag}: {text_of(source)!r} becomes {text_of(found[source])!r} and "
                f"{text_of(target)!r}; expected one entry a source"
            )
    if not found:
        raise InputInvalid(f"{place}: a {tag} without entries; expected <ssc:MapEntry …>")
    return tuple(found.items())


def _value(entry: Xml, attribute: str, type_: type, place: str) -> Any:
    text = entry.get(attribute)
    try:
        if text is None:
            raise ValueError
        if type_ is bool:
            return {"true": True, "1": True, "false": False, "0": False}[text.strip()]
        return type_(text)
    except (ValueError, KeyError):
        raise InputInvalid(
            f"{place}: <ssc:MapEntry> with {attribute} {text!r}; expected {_EXPECTED[type_]}"
        ) from None


def add_table(parent: Xml, table: Table) -> None:
    """Write a table into a connection."""
    kind = next(name for name, type_ in _KINDS.items() if type(table[0][0]) is type_)
    xml = SubElement(parent, f"ssc:{kind}MappingTransformation")
    for source, target in table:
        SubElement(xml, "ssc:MapEntry", source=text_of(source), target=text_of(target))


def looked_up(table: Table, value: Any, place: str) -> Any:
    """Return what a parameter's value becomes; lists element by element. Raises InputInvalid."""
    if isinstance(value, list | tuple):
        return [looked_up(table, v, place) for v in value]
    wanted = type(table[0][0])
    key = getattr(value, "item", value) if wanted is str else value
    right = isinstance(key, wanted) and (wanted is bool or not isinstance(key, bool))
    if not right:
        raise InputInvalid(f"{place} is {value!r}; expected {_EXPECTED[wanted]}, which is mapped")
    found = dict(table)
    if key not in found:
        expected = listed(table)
        if isinstance(key, str):
            expected = expected_names(key, [str(k) for k in found], expected)
        raise InputInvalid(f"{place} is {text_of(key)!r}, which has no entry; expected {expected}")
    return found[key]


def listed(table: Sequence[tuple[Any, Any]]) -> str:
    """Name the sources of a table for an error."""
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
            raise Misfit(
                f"a table of {_words(type_)} at {v.name} of type {v.type}", f"type {kinds[type_]}"
            )
    if type_ is not str:
        return tuple((int(a), int(b)) for a, b in table)
    return tuple((_item(source, str(a)), _item(target, str(b))) for a, b in table)


def _words(type_: type) -> str:
    return {bool: "Booleans", int: "integers", str: "names of items"}[type_]


def _item(variable: Variable, name: str) -> int:
    numbers = dict(variable.items)
    if name not in numbers:
        raise Misfit(
            f"item {name!r} of {variable.name} in a table",
            expected_names(name, list(numbers), "an item of its enumeration"),
        )
    return int(numbers[name])


def chained_tables(first: Table, second: Table) -> Table:
    """Return what two tables on one way do; raises Misfit where nothing comes through."""
    last = dict(second)
    both = tuple((a, last[b]) for a, b in first if b in last)
    if not both:
        raise Misfit("two tables on one way, of which the second has no entry for any value of "
                     "the first", "entries that fit")  # fmt: skip
    return both
