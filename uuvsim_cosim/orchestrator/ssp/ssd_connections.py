"""Connections of an SSD: direction of values, and conversions at a system's border."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.parameters.ssp_xml import q
from uuvsim_cosim.orchestrator.system.elements import Connection, Exposed
from uuvsim_cosim.orchestrator.values.transformation import (
    PLAIN,
    Transformation,
    chained,
    read_transformation,
)

__all__ = ["Border", "End", "Link", "Links", "UnitOf", "Wanted", "read_links"]

_INTO = ("input", "parameter", "structuralParameter")
_OUT_OF = ("output", "local", "calculatedParameter", "constant")


@dataclass(frozen=True)
class End:
    """A connector of an element, or ("" for the element) of the system itself."""

    element: str
    connector: str
    index: str = ""

    @property
    def text(self) -> str:
        """Text of the endpoint, ``element.connector[index]``."""
        name = f"{self.connector}{self.index}"
        return f"{self.element}.{name}" if self.element else name


@dataclass(frozen=True)
class Wanted:
    """A signal of a dictionary that a system writes or reads, through one of its connectors."""

    dictionary: str
    entry: str
    writes: bool
    connector: str
    change: Transformation = PLAIN


@dataclass
class Border:
    """Requirements of a nested system on the system around it."""

    changes: dict[str, Transformation] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    idle: set[str] = field(default_factory=set)  # connectors without a connection inside
    signals: list[Wanted] = field(default_factory=list)


Link = tuple[End, End, Transformation]  # from source to target
UnitOf = Callable[[End], str | None]


@dataclass
class Links:
    """Connections of one system, its exposed connectors, and their transformations."""

    connections: list[Link] = field(default_factory=list)
    exposed: list[Exposed] = field(default_factory=list)
    changes: dict[str, Transformation] = field(default_factory=dict)

    def listed(self) -> Iterator[Connection]:
        """List the connections."""
        for a, b, change in self.connections:
            yield Connection(a.text, b.text, change.factor, change.offset, change.convert,
                             change.table)  # fmt: skip

    def wrap(
        self, borders: Mapping[str, Border], unit_of: UnitOf, units: Mapping[str, Unit]
    ) -> None:
        """Add the transformations inside of nested systems to the connections outside."""
        for i, (a, b, change) in enumerate(self.connections):
            for end in (b, a):
                border = borders.get(end.element, Border())
                inner = border.changes.get(end.connector, PLAIN)
                if inner == PLAIN:
                    continue
                named = (unit_of(a), border.units.get(end.connector), unit_of(b))
                both = (inner, change) if end == a else (change, inner)
                change = chained(*both, named, units)
            self.connections[i] = (a, b, change)


def read_links(xml: Xml, wrong: Callable[[InputInvalid], None], place: str) -> Links:
    """Read the connections of a system; `place` ends in a dot; errors go to `wrong`."""
    # The kind of each connector, by element ("" for the system itself) and name.
    causalities: dict[tuple[str, str], str] = {}
    section = xml.find(q("ssd:Elements"))
    owners = [(e.get("name", ""), e) for e in (section if section is not None else ())]
    for name, owner in [("", xml), *owners]:
        for c in owner.iterfind(f"{q('ssd:Connectors')}/{q('ssd:Connector')}"):
            causalities[name, c.get("name", "")] = c.get("kind", "")
    links = Links()
    for item in xml.iterfind(f"{q('ssd:Connections')}/{q('ssd:Connection')}"):
        try:
            _read(item, causalities, links, place)
        except InputInvalid as error:
            wrong(error)
    return links


def _read(item: Xml, causalities: Mapping[tuple[str, str], str], links: Links, place: str) -> None:
    """Add one connection to the links; raises InputInvalid."""
    start, end = _end(item, "start", place), _end(item, "end", place)
    here = f"{place}<ssd:Connection> {start.text} to {end.text}"
    change = read_transformation(item, here)
    if not start.element and not end.element:
        raise InputInvalid(here, "both are connectors of the system", "an element between them")
    if start.element and end.element:
        # In SSP, start and end do not define the direction of flow; the connectors' `kind` does.
        first = causalities.get((start.element, start.connector), "")
        second = causalities.get((end.element, end.connector), "")
        if first in _INTO or (first not in _OUT_OF and second in _OUT_OF):
            start, end = end, start
        links.connections.append((start, end, change))
        return
    outer, inner = (start, end) if not start.element else (end, start)
    links.exposed.append(Exposed(outer.text, inner.text))
    if links.changes.setdefault(outer.connector, change) != change:
        raise InputInvalid(
            here,
            f"another transformation than at the other connections of {outer.connector!r}",
            "the same at each",
        )


def _end(item: Xml, side: str, place: str) -> End:
    """Read the connector at one side of a connection, "start" or "end"."""
    element, connector = item.get(f"{side}Element", ""), item.get(f"{side}Connector", "")
    if not connector:
        raise InputInvalid(
            f"{place}<ssd:Connection>", f"no {side}Connector", "the name of a connector"
        )
    indices = item.get(f"{side}Indices", "").split()
    if not all(i.isdecimal() for i in indices):
        raise InputInvalid(
            f"{place}<ssd:Connection>",
            f"{side}Indices {' '.join(indices)!r}",
            "whole numbers from 1, such as '2' or '1 3'",
        )
    return End(element, connector, f"[{','.join(indices)}]" if indices else "")
