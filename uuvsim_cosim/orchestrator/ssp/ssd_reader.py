"""Reader of system structure descriptions (.ssd), which reports all problems of a file at once."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid, Problem, SystemInvalid, UuvsimError
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.orchestrator.parameters.ssp_xml import (
    find_annotation,
    q,
    read_document,
    read_units,
)
from uuvsim_cosim.orchestrator.parameters.ssv import read_enumerations
from uuvsim_cosim.orchestrator.ssp.annotations import (
    component_step,
    system_step,
    variable_step_of,
)
from uuvsim_cosim.orchestrator.ssp.signal_dictionary import (
    read_dictionaries,
    read_references,
    resolve_signals,
)
from uuvsim_cosim.orchestrator.ssp.ssd_bindings import Bindings
from uuvsim_cosim.orchestrator.ssp.ssd_connections import Border, End, Links, read_links
from uuvsim_cosim.orchestrator.system.elements import Element, StepGroup
from uuvsim_cosim.orchestrator.system.resolve import REMARK, proxy_file
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.system.validation import as_step, describe_element, problem_of
from uuvsim_cosim.orchestrator.values.endpoints import find_variable
from uuvsim_cosim.orchestrator.values.values import Misfit
from uuvsim_cosim.orchestrator.values.xml_values import float_of, local_name

__all__ = ["read_ssd"]

DEFAULT_TICK = "0.01"
_BROKEN = "broken"


def read_ssd(path: Path, tick: str | None = None, confined: bool = False) -> System:
    """Read a system from a file of SSP 1.0 or 2.0.

    `tick` is the step if the file has none. If `confined`, files of sources must be in the file's
    folder. Raises SystemInvalid with every problem.
    """
    place = shown(path)
    remarks: list[str] = []
    root = read_document(path, "ssd:SystemStructureDescription", remarks)
    version = root.get("version", "")
    if not version.startswith(("1.", "2.")):
        raise InputInvalid(place, f"SSP version {version!r}", "1.0 or 2.0")
    top = root.find(q("ssd:System"))
    if top is None:
        raise InputInvalid(place, "no <ssd:System>", "one")
    experiment = root.find(q("ssd:DefaultExperiment"))
    reader = _Reader(path, confined, root)
    system = reader.system(top, tick, remarks=remarks)
    if reader.problems or system is None:
        raise SystemInvalid([replace(p, place=f"{path.name}: {p.place}") for p in reader.problems])
    if experiment is None:
        return system
    start, stop = (float_of(experiment, name, place, 0.0) for name in ("startTime", "stopTime"))
    stop_time = stop if start < stop < math.inf else None
    if not 0.0 <= start < math.inf:
        remark = f"{path.name}: startTime {start:g} s: a run starts at 0 s, the first possible time"
        system, start = replace(system, remarks=(*system.remarks, remark)), 0.0
        stop_time = stop if 0.0 < stop < math.inf else None
    return replace(system, start_time=start, stop_time=stop_time)


class _Reader:
    """Reader of the elements of one file; it gathers problems with their place in the hierarchy."""

    def __init__(self, path: Path, confined: bool, root: Xml) -> None:
        self.path, self.folder, self.confined, self.root = path, path.parent, confined, root
        self.problems: list[Problem] = []
        self.borders: dict[str, Border] = {}  # of nested systems, by path
        self.inside: set[str] = set()  # ids of systems that are being read
        units = read_units(root, "ssd:Units", shown(path))
        enumerations = read_enumerations(root, "ssd:Enumerations", shown(path))
        self.bindings = Bindings(self.folder, units, enumerations, self._confine)

    def wrong(self, error: UuvsimError, place: str = "") -> None:
        """Note the problems of an error; `place` is for those that have none of their own."""
        for p in error.problems:
            own = UuvsimError(p.read, p.expected) if p.place else error
            self.problems.append(problem_of(p.place or place, own))

    def system(
        self, xml: Xml, tick: str | None, prefix: str = "", remarks: list[str] | None = None
    ) -> System | None:
        """Read a system; `tick` is the step of the one around it, or the user's."""
        note = find_annotation(xml)
        remarks = remarks if remarks is not None else []
        try:
            own_step = system_step(self.root, xml, remarks)
        except UuvsimError as error:
            self.wrong(error)
            own_step = DEFAULT_TICK
        if own_step is None and tick is None and not prefix:
            remarks.append(f"states no step: {DEFAULT_TICK} s is used")
        step = own_step or tick or DEFAULT_TICK
        elements, broken = self._elements(xml, step, prefix, remarks)
        links = read_links(xml, self.wrong, prefix)
        connectors = xml.iterfind(f"{q('ssd:Connectors')}/{q('ssd:Connector')}")
        idle = {c.get("name", "") for c in connectors} - {x.name for x in links.exposed}
        border = Border(links.changes, _connector_units(xml), idle)
        self._resolve(xml, elements, links, border, prefix, remarks)
        elements = self._bind_system(xml, elements, links, prefix, remarks)
        groups: list[StepGroup] = []
        for group in note if note is not None else ():
            if local_name(group) != "Group":
                continue
            members = tuple(m.get("name", "") for m in group)
            try:
                tolerance, limit = float(group.get("tolerance", "1e-10")), group.get("limit", "100")
                numbers = (tolerance, int(limit))
            except ValueError:
                numbers = (math.nan, 0)  # the system's check refuses them
            algorithm, solver = group.get("algorithm", ""), group.get("solver", "newton")
            groups.append(StepGroup(members, algorithm, solver, *numbers))  # type: ignore[arg-type]
        own = note.attrib if note is not None else {}
        try:
            varied = None if note is None else variable_step_of(note)
        except UuvsimError as error:
            self.wrong(error)
            varied = None
        self.borders[prefix] = border
        known = {e.name for e in elements} - broken
        try:
            return System(
                own.get("name", xml.get("name", "")),
                step,
                own.get("description", xml.get("description", "")),
                tuple(elements),
                tuple(links.listed()),
                tuple(groups),
                tuple(links.exposed),
                self.folder,
                tuple(dict.fromkeys(f"{self.path.name}: {r}" for r in remarks)),
                # System checks both policies.
                loops=own.get("loops", "iterate"),  # type: ignore[arg-type]
                mismatches=own.get("mismatches", "refuse"),  # type: ignore[arg-type]
                variable_step=varied,
                events=own.get("events") == "true",
            )
        except SystemInvalid as error:
            for p in error.problems:
                if p.place not in broken or p.place in known:
                    self.problems.append(replace(p, place=prefix + p.place))
            return None

    def _elements(
        self, xml: Xml, tick: str, prefix: str, remarks: list[str]
    ) -> tuple[list[Element], set[str]]:
        found: list[Element] = []
        broken: set[str] = set()
        section = xml.find(q("ssd:Elements"))
        for child in section if section is not None else ():
            name = child.get("name", "")
            place = f"{prefix}{name}"
            source = child.get("source", "")
            if child.tag == q("ssd:System"):
                found.append(self._nested(child, child, tick, place, broken))
            elif child.tag == q("ssd:Component") and source.startswith("#"):
                found.append(self._reference(child, source[1:], tick, place, broken, remarks))
            elif child.tag == q("ssd:Component"):
                found.append(self._component(child, tick, place, remarks))
                if found[-1].source == _BROKEN:
                    broken.add(name)
            elif child.tag != q("ssd:SignalDictionaryReference"):
                tag = local_name(child) or "comment"
                self.problems.append(Problem(place, f"a {tag}", "a Component or a System"))
        return found, broken

    def _nested(
        self, definition: Xml, xml: Xml, tick: str, place: str, broken: set[str]
    ) -> Element:
        name = xml.get("name", "")
        nested = self.system(definition, tick, f"{place}.")
        if nested is None:
            broken.add(name)
        note = find_annotation(xml)
        text = xml.get("description", "")
        own = text if note is not None and "description" in note.attrib else ""
        return self._units(Element(name, nested or _BROKEN, description=own), xml)

    def _reference(
        self, xml: Xml, id: str, tick: str, place: str, broken: set[str], remarks: list[str]
    ) -> Element:
        """Read a component whose source is the id of a system of the same file."""
        name = xml.get("name", "")
        found = next((s for s in self.root.iter(q("ssd:System")) if s.get("id") == id), None)
        if found is None or id in self.inside:
            read = f"source '#{id}', {'which it is part of' if id in self.inside else 'unknown'}"
            self.problems.append(Problem(place, read, "the id of another system of the file"))
            broken.add(name)
            return Element(name, _BROKEN)
        self.inside.add(id)
        element = self._nested(found, xml, tick, place, broken)
        self.inside.discard(id)
        values = self.bindings.read(xml, place, self.wrong)
        return self._set(element, {v.name: v.value for v in values}, place, remarks)

    def _component(self, xml: Xml, tick: str, place: str, remarks: list[str]) -> Element:
        source = unquote(xml.get("source", ""))
        name = xml.get("name", "")
        if not source:
            read = "no source" if xml.get("source") is None else "an empty source"
            self.problems.append(Problem(place, read, "an FMU, an .ssd or an .ssp"))
            return Element(name, _BROKEN)
        try:
            file = proxy_file(source)
        except InputInvalid as error:
            self.problems.append(problem_of(place, error))
            return Element(name, _BROKEN)
        if file is not None:
            source = file
            remarks.append(f"{place}: {REMARK}")
        self._confine(source, place)
        wanted = xml.get("implementation", "any")
        if wanted not in ("any", "CoSimulation", "ModelExchange", "ScheduledExecution"):
            read = f"implementation {wanted!r}"
            self.problems.append(
                Problem(place, read, "CoSimulation, ModelExchange, ScheduledExecution or any")
            )
        elif wanted not in ("any", "CoSimulation") and Path(source).suffix.lower() == ".fmu":
            source = f"{source}#interface={wanted}"
        try:
            step = component_step(xml, as_step(tick, place), remarks)
        except UuvsimError as error:
            self.wrong(error)
            step = None
        element = Element(
            name, source,
            rate=None if step is None else as_step(step, place),
            description=xml.get("description", ""),
        )  # fmt: skip
        start = {v.name: v.value for v in self.bindings.read(xml, place, self.wrong)}
        return self._units(self._set(element, start, place, remarks), xml)

    def _set(
        self, element: Element, start: dict[str, object], place: str, remarks: list[str]
    ) -> Element:
        """Set start values of a component, or of components in a nested system."""
        if not start or element.source == _BROKEN:
            return element
        text = element.source if isinstance(element.source, str) else None
        if text is not None and not text.partition("#")[0].lower().endswith((".ssd", ".ssp")):
            return replace(element, start={**element.start, **start})
        for name, value in start.items():
            owner, _, connector = f"{place}.{name}".rpartition(".")
            if connector in self.borders.get(f"{owner}.", Border()).idle:
                remarks.append(f"value of '{place}.{name}', a connector that is not connected")
                continue
            try:
                alone = System("", elements=(element,), base=self.folder)
                element = alone.set(f"{element.name}.{name}", value).elements[0]
            except SystemInvalid as error:
                outer = place.removesuffix(element.name)
                self.problems.extend(replace(p, place=f"{outer}{p.place}") for p in error.problems)
        return element

    def _units(self, element: Element, xml: Xml) -> Element:
        """Use the units of connectors for variables whose description names none."""
        given = _connector_units(xml)
        if not given or element.source == _BROKEN:
            return element
        try:
            variables = describe_element(element, self.folder).variables
        except UuvsimError:
            return element  # found again, and reported, when the system is checked
        units: dict[str, str] = {}
        for name, unit in given.items():
            known = name if name in variables else split_element_name(name)[0]
            if known in variables and None in variables[known].units:
                units[known] = unit
        note = find_annotation(xml)
        for item in note if note is not None else ():
            if item.tag == q("uuvsim:Units"):
                units[item.get("name", "")] = item.get("units", "")
        return replace(element, units=units)

    # ---- connections and values of a system -----------------------------------------------

    def _resolve(
        self, xml: Xml, elements: list[Element], links: Links, border: Border, prefix: str,
        remarks: list[str],
    ) -> None:  # fmt: skip
        """Replace signal dictionaries by connections, and apply the borders' transformations."""
        by_name = {e.name: e for e in elements}
        borders = {e.name: self.borders.get(f"{prefix}{e.name}.", Border()) for e in elements}

        def unit_of(end: End) -> str | None:
            try:
                described = describe_element(by_name[end.element], self.folder)
                return find_variable(f"{end.connector}{end.index}", described)[0].unit
            except (KeyError, Misfit, UuvsimError):
                return None  # found again, and reported, when the system is checked

        try:
            own = read_dictionaries(xml, self.folder, self._confine, prefix)
            references = read_references(xml)
            wanted, notes = resolve_signals(
                links, references, own, borders, unit_of, self.bindings.units, prefix
            )
            links.wrap(borders, unit_of, self.bindings.units)
        except Misfit as error:
            self.problems.append(error.at(prefix))
            return
        except InputInvalid as error:
            self.wrong(error, prefix)
            return
        remarks += notes
        border.signals = wanted
        if not prefix:
            for w in wanted:
                read = f"no signal dictionary {w.dictionary!r}"
                self.problems.append(Problem(w.connector, read, "one in a system around it"))

    def _bind_system(
        self, xml: Xml, elements: list[Element], links: Links, prefix: str, remarks: list[str]
    ) -> list[Element]:
        """Apply a system's parameter bindings, whose names lead through its elements."""
        by_name = {e.name: e for e in elements}
        own: dict[str, list[str]] = {}
        for item in links.exposed:
            own.setdefault(item.name, []).append(item.path)
        for value in self.bindings.read(xml, prefix.rstrip(".") or self.path.name, self.wrong):
            paths = own.get(value.name, [value.name])
            found = [(n, p[len(n) + 1 :]) for p in paths for n in by_name if p.startswith(f"{n}.")]
            if not found:
                remarks.append(f"value of {value.name!r} belongs to no component")
            for name, rest in found:
                by_name[name] = self._set(
                    by_name[name], {rest: value.value}, f"{prefix}{name}", remarks
                )
        return [by_name[e.name] for e in elements]

    # ---- files ----------------------------------------------------------------------------

    def _confine(self, source: str, place: str) -> None:
        """Note a problem for a source outside of the archive."""
        if not self.confined or source.startswith(("model:", "function:")):
            return
        inside = (self.folder / source).resolve().is_relative_to(self.folder.resolve())
        if Path(source).is_absolute() or not inside:
            self.problems.append(
                Problem(place, f"source {source!r}, outside the archive", "a file inside it")
            )


def _connector_units(xml: Xml) -> dict[str, str]:
    """Return the units of an element's connectors, where they name one."""
    given: dict[str, str] = {}
    for connector in xml.iterfind(f"{q('ssd:Connectors')}/{q('ssd:Connector')}"):
        unit = next((e.get("unit") for e in connector if e.get("unit")), None)
        if unit:
            given[connector.get("name", "")] = unit
    return given
