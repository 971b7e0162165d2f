"""System structure descriptions (.ssd): a system is read, with all problems of the file at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid, Problem, SystemInvalid, UuvsimError
from uuvsim_cosim.fmus.archive import shown
from uuvsim_cosim.fmus.safe_xml import parse_xml
from uuvsim_cosim.models.units import Unit
from uuvsim_cosim.orchestrator.elements import Connection, Element, Exposed, StepGroup
from uuvsim_cosim.orchestrator.ssm import read_mapping, read_ssm
from uuvsim_cosim.orchestrator.ssp_xml import boolean, find_annotation, q, read_units
from uuvsim_cosim.orchestrator.ssv import ParameterValue, read_parameter_set, read_ssv
from uuvsim_cosim.orchestrator.system import System
from uuvsim_cosim.orchestrator.validation import describe_element, problem_of
from uuvsim_cosim.orchestrator.values import Quantity

__all__ = ["read_ssd"]

DEFAULT_TICK = "0.01"
_BROKEN = "broken"


def read_ssd(path: Path, tick: str | None = None, confined: bool = False) -> System:
    """Read a system from a file of SSP 1.0 or 2.0.

    `tick` is taken where the file gives none. Files that sources name must lie in the file's
    folder if `confined`. Raises SystemInvalid with every problem.
    """
    place = shown(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputInvalid(f"{place}: {error.strerror}; expected an .ssd file") from None
    root = parse_xml(data, place, InputInvalid)
    if root.tag != q("ssd:SystemStructureDescription"):
        tag = root.tag.rpartition("}")[2]
        raise InputInvalid(f"{place}: <{tag}>; expected <ssd:SystemStructureDescription>")
    version = root.get("version", "")
    if not version.startswith(("1.", "2.")):
        raise InputInvalid(f"{place}: SSP version {version!r}; expected 1.0 or 2.0")
    top = root.find(q("ssd:System"))
    if top is None:
        raise InputInvalid(f"{place}: no <ssd:System>; expected one")
    reader = _Reader(path, confined, tick, read_units(root, "ssd:Units"))
    system = reader.system(top)
    if reader.problems or system is None:
        raise SystemInvalid([replace(p, place=f"{path.name}: {p.place}") for p in reader.problems])
    return system


class _Reader:
    """Reads elements of one file, and gathers problems with their place in the hierarchy."""

    def __init__(
        self, path: Path, confined: bool, tick: str | None, units: Mapping[str, Unit]
    ) -> None:
        self.path = path
        self.folder = path.parent
        self.confined = confined
        self.tick = tick
        self.units = units
        self.problems: list[Problem] = []

    def system(self, xml: Xml, prefix: str = "") -> System | None:
        note = find_annotation(xml)
        remarks: list[str] = []
        tick = self.tick or DEFAULT_TICK
        if note is not None and note.get("tick"):
            tick = note.get("tick", tick)
        elif self.tick is None and not prefix:
            remarks.append(f"{self.path.name} gives no step: {tick} s is taken")
        elements, broken = self._elements(xml, prefix)
        elements = self._bind_system(xml, elements, prefix, remarks)
        kinds = _connector_kinds(xml)
        connections, exposed = _connections(xml, kinds)
        groups = tuple(_group(g) for g in (note if note is not None else ()))
        own = note.attrib if note is not None else {}
        try:
            return System(
                own.get("name", xml.get("name", "")),
                tick,
                own.get("description", xml.get("description", "")),
                tuple(elements),
                tuple(connections),
                groups,
                tuple(exposed),
                self.folder,
                tuple(remarks),
            )
        except SystemInvalid as error:
            for p in error.problems:
                if p.place not in broken:
                    self.problems.append(replace(p, place=prefix + p.place))
            return None

    def _elements(self, xml: Xml, prefix: str) -> tuple[list[Element], set[str]]:
        found: list[Element] = []
        broken: set[str] = set()
        section = xml.find(q("ssd:Elements"))
        for child in section if section is not None else ():
            name = child.get("name", "")
            place = f"{prefix}{name}"
            if child.tag == q("ssd:System"):
                nested = self.system(child, f"{place}.")
                if nested is None:
                    broken.add(name)
                note = find_annotation(child)
                text = child.get("description", "")
                own = text if note is not None and "description" in note.attrib else ""
                element = Element(name, nested or _BROKEN, description=own)
                found.append(self._units(element, child))
            elif child.tag == q("ssd:Component"):
                found.append(self._component(child, place))
            else:
                tag = child.tag.rpartition("}")[2]
                self.problems.append(Problem(place, f"a {tag}", "a Component or a System"))
        return found, broken

    def _component(self, xml: Xml, place: str) -> Element:
        note = find_annotation(xml)
        source = unquote(xml.get("source", ""))
        self._confine(source, place)
        if xml.get("implementation") == "ModelExchange":
            self.problems.append(Problem(place, "implementation ModelExchange", "CoSimulation"))
        rate: Any = None if note is None else note.get("step")
        element = Element(
            xml.get("name", ""), source, rate=rate, description=xml.get("description", "")
        )
        start: dict[str, Any] = {}
        for value in self._bindings(xml, place):
            start[value.name] = value.value
        element = replace(element, start=start)
        if start and source.lower().endswith((".ssd", ".ssp")):
            element = self._set_nested(element)
        return self._units(element, xml)

    def _set_nested(self, element: Element) -> Element:
        """Put values for a nested system where they belong: into its components."""
        try:
            alone = System("", elements=(replace(element, start={}),), base=self.folder)
            for name, value in element.start.items():
                alone = alone.set(f"{element.name}.{name}", value)
        except SystemInvalid as error:
            self.problems.extend(error.problems)
            return replace(element, start={})
        return alone.elements[0]

    def _units(self, element: Element, xml: Xml) -> Element:
        """Take the units of connectors for variables whose description names none."""
        given: dict[str, str] = {}
        for connector in xml.iterfind(f"{q('ssd:Connectors')}/{q('ssd:Connector')}"):
            unit = next((e.get("unit") for e in connector if e.get("unit")), None)
            if unit:
                given[connector.get("name", "")] = unit
        if not given or element.source == _BROKEN:
            return element
        try:
            variables = describe_element(element, self.folder).variables
        except UuvsimError:
            return element  # found again, and reported, when the system is checked
        units: dict[str, str] = {}
        for name, unit in given.items():
            known = name if name in variables else name.rpartition("[")[0]
            if known in variables and None in variables[known].units:
                units[known] = unit
        note = find_annotation(xml)
        for item in note if note is not None else ():
            if item.tag == q("uuvsim:Units"):
                units[item.get("name", "")] = item.get("units", "")
        return replace(element, units=units)

    def _bind_system(
        self, xml: Xml, elements: list[Element], prefix: str, remarks: list[str]
    ) -> list[Element]:
        """Apply a system's parameter bindings, whose names lead through its elements."""
        by_name = {e.name: e for e in elements}
        for value in self._bindings(xml, prefix.rstrip(".")):
            owner, _, rest = value.name.partition(".")
            if owner not in by_name or not rest:
                remarks.append(f"{self.path.name}: value of {value.name!r} belongs to no component")
                continue
            element = by_name[owner]
            if isinstance(element.source, System):
                try:
                    nested = element.source.set(rest, value.value)
                    by_name[owner] = replace(element, source=nested)
                except SystemInvalid as error:
                    self.problems.extend(
                        replace(p, place=f"{prefix}{owner}.{p.place}") for p in error.problems
                    )
            else:
                by_name[owner] = replace(element, start={**element.start, rest: value.value})
        return [by_name[e.name] for e in elements]

    def _bindings(self, xml: Xml, place: str) -> list[ParameterValue]:
        """Read the values that an element is given, with their units, the last ones last."""
        found: list[ParameterValue] = []
        for binding in xml.iterfind(f"{q('ssd:ParameterBindings')}/{q('ssd:ParameterBinding')}"):
            try:
                values = self._binding(binding, place)
            except UuvsimError as error:
                self.problems.append(problem_of(place or self.path.name, error))
            else:
                prefix = binding.get("prefix", "")
                found += [replace(v, name=f"{prefix}{v.name}") for v in values]
        return found

    def _binding(self, binding: Xml, place: str) -> list[ParameterValue]:
        source = binding.get("source")
        definitions: Mapping[str, Unit] = self.units
        if source is not None:
            values, definitions = read_ssv(self._file(binding, source, place))
        else:
            inline = binding.find(f"{q('ssd:ParameterValues')}/{q('ssv:ParameterSet')}")
            values = [] if inline is None else read_parameter_set(inline, place)
        values = [
            replace(v, value=Quantity(v.value, v.unit, definitions) if v.unit else v.value)
            for v in values
        ]
        mapping = binding.find(q("ssd:ParameterMapping"))
        return values if mapping is None else self._mapped(values, mapping, place)

    def _mapped(
        self, values: list[ParameterValue], mapping: Xml, place: str
    ) -> list[ParameterValue]:
        source = mapping.get("source")
        if source is not None:
            entries = read_ssm(self._file(mapping, source, place))
        else:
            inline = mapping.find(q("ssm:ParameterMapping"))
            entries = [] if inline is None else read_mapping(inline, place)
        by_name = {v.name: v for v in values}
        result: list[ParameterValue] = []
        for entry in entries:
            if entry.source not in by_name:
                continue
            value = by_name[entry.source]
            if (entry.factor, entry.offset) != (1.0, 0.0):
                bare = value.value.value if isinstance(value.value, Quantity) else value.value
                scaled = [entry.factor * v + entry.offset for v in _listed(bare)]
                shaped = scaled if isinstance(bare, list) else scaled[0]
                value = replace(value, value=shaped)
            result.append(replace(value, name=entry.target))
        return result

    def _file(self, xml: Xml, source: str, place: str) -> Path:
        if xml.get("sourceBase", "SSD") != "SSD":
            raise InputInvalid(
                f"{place}: sourceBase {xml.get('sourceBase')!r}; expected a file beside the .ssd"
            )
        name = unquote(source)
        self._confine(name, place)
        return self.folder / name

    def _confine(self, source: str, place: str) -> None:
        """Refuse files of an archive that would lie outside it."""
        if not self.confined or source.startswith("model:"):
            return
        inside = (self.folder / source).resolve().is_relative_to(self.folder.resolve())
        if Path(source).is_absolute() or not inside:
            self.problems.append(
                Problem(place, f"source {source!r}, outside the archive", "a file inside it")
            )


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _connector_kinds(xml: Xml) -> dict[tuple[str, str], str]:
    """Give the kind of each connector, by element ("" for the system itself) and name."""
    kinds: dict[tuple[str, str], str] = {}
    section = xml.find(q("ssd:Elements"))
    owners = [("", xml)] + [
        (e.get("name", ""), e) for e in (section if section is not None else ())
    ]
    for name, owner in owners:
        for c in owner.iterfind(f"{q('ssd:Connectors')}/{q('ssd:Connector')}"):
            kinds[name, c.get("name", "")] = c.get("kind", "")
    return kinds


def _connections(
    xml: Xml, kinds: Mapping[tuple[str, str], str]
) -> tuple[list[Connection], list[Exposed]]:
    connections: list[Connection] = []
    exposed: list[Exposed] = []
    for item in xml.iterfind(f"{q('ssd:Connections')}/{q('ssd:Connection')}"):
        start, end = _end(item, "start"), _end(item, "end")
        # In SSP, start and end say nothing of the direction of flow: the connectors' kinds do.
        key = (item.get("startElement", ""), item.get("startConnector", ""))
        outer = "" in (item.get("startElement", ""), item.get("endElement", ""))
        if outer:
            name, path = (start, end) if not item.get("startElement") else (end, start)
            exposed.append(Exposed(name, path))
            continue
        if kinds.get(key) == "input":
            start, end = end, start
        factor, offset = 1.0, 0.0
        linear = item.find(q("ssc:LinearTransformation"))
        if linear is not None:
            factor, offset = float(linear.get("factor", 1)), float(linear.get("offset", 0))
        convert = not boolean(item.get("suppressUnitConversion"))
        connections.append(Connection(start, end, factor, offset, convert))
    return connections, exposed


def _end(item: Xml, side: str) -> str:
    element, connector = item.get(f"{side}Element"), item.get(f"{side}Connector", "")
    indices = item.get(f"{side}Indices")
    index = f"[{','.join(indices.split())}]" if indices else ""
    return f"{element}.{connector}{index}" if element else f"{connector}{index}"


def _group(xml: Xml) -> StepGroup:
    """Read a group; what is no number becomes one that the system's check refuses."""
    members = tuple(m.get("name", "") for m in xml)
    try:
        tolerance, limit = float(xml.get("tolerance", "1e-10")), int(xml.get("limit", "100"))
    except ValueError:
        tolerance, limit = math.nan, 0
    algorithm, solver = xml.get("algorithm", ""), xml.get("solver", "newton")
    return StepGroup(members, algorithm, solver, tolerance, limit)  # type: ignore[arg-type]
