"""Transformation of a value by a connection or a mapping: unit, factor and offset, or a table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.values.value_table import Table, chained_tables, read_table
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion
from uuvsim_cosim.orchestrator.values.xml_values import boolean, float_of

__all__ = ["PLAIN", "Transformation", "chained", "read_transformation"]


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
        tag = child.tag.rpartition("}")[2] if isinstance(child.tag, str) else ""
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
        return Transformation(table=chained_tables(first.table, second.table))
    if first.table or second.table:
        if first.scales or second.scales:
            raise Misfit("a table, and a factor or offset, on one way", "one of the two")
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
