"""Writer of system structure descriptions (.ssd), without loss."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import quote
from xml.etree.ElementTree import Element as Xml
from xml.etree.ElementTree import SubElement

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.models.declaration.element_names import index_text
from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.parameters.ssp_xml import (
    MIME,
    SspVersion,
    add_annotation,
    add_units,
    document,
    has_arrays,
    type_name,
)
from uuvsim_cosim.orchestrator.parameters.ssv import parameter_set
from uuvsim_cosim.orchestrator.ssp.annotations import (
    add_component_step,
    add_default_experiment,
    add_system_step,
    step_for_others,
    variable_step_xml,
)
from uuvsim_cosim.orchestrator.ssp.ssd_reader import read_ssd
from uuvsim_cosim.orchestrator.system.elements import Element, step_text
from uuvsim_cosim.orchestrator.system.resolve import (
    is_vehicle_path,
    resolve,
    with_vehicle_paths,
)
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.values.endpoints import (
    Endpoint,
    find_variable,
    resolve_endpoint,
)
from uuvsim_cosim.orchestrator.values.transformation import add_table
from uuvsim_cosim.orchestrator.values.values import is_float
from uuvsim_cosim.orchestrator.values.xml_values import number

__all__ = ["format_ssd", "read_ssd", "write_ssd"]


def write_ssd(system: System, path: Path, version: SspVersion = "2.0") -> None:
    """Write a `system` to the file `path` as .ssd of SSP `version` 1.0 or 2.0.

    Relative files of its sources are named from the file's folder. Raises InputInvalid if the file
    cannot be written.

    Example:

    >>> from pathlib import Path
    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.orchestrator import write_ssd
    >>> bench = uuv.System("bench").add("battery", "model:battery")
    >>> write_ssd(bench, Path("bench.ssd"), version="1.0")
    >>> uuv.load("bench.ssd") == bench
    True
    """
    data = format_ssd(system, version, path.parent)
    try:
        write_whole(path, data)
    except OSError as error:
        raise InputInvalid(
            path, f"cannot be written ({error.strerror})", "a folder that can be written"
        ) from None


def format_ssd(system: System, version: SspVersion = "2.0", folder: Path | None = None) -> bytes:
    """Return the document; `folder` is that of the file (default: the system's base)."""
    writer = _Writer(version, folder or system.base or Path())
    root = Xml(
        "ssd:SystemStructureDescription",
        version=version,
        name=system.name,
        generationTool=f"uuvsim-cosim {__version__}",
    )
    root.append(writer.system(system, system.name))
    add_units(root, writer.unit_names, writer.units, "ssd:Units")
    add_default_experiment(root, step_for_others(system), system.start_time, system.stop_time)
    return document(root, "oms", "osp", "ssc", "ssd", "ssv", "uuvsim")


End = tuple[Endpoint, int | None, bool]  # connector, element of it, whether arrays are whole


class _Writer:
    """Writer of elements; it gathers the units that they refer to."""

    def __init__(self, version: SspVersion, folder: Path) -> None:
        self.version: SspVersion = version
        self.folder = folder
        self.unit_names: set[str] = set()
        self.units: dict[str, Unit] = {}

    def system(self, system: System, name: str, description: str = "") -> Xml:
        xml = Xml("ssd:System", name=name)
        if description or system.description:
            xml.set("description", description or system.description)
        interface = system.interface()
        self._connectors(xml, interface, list(interface.variables))
        used: dict[str, list[str]] = {e.name: [] for e in system.elements}
        for wire in system.checked.wires:
            for point in (wire.source, wire.target):
                used[point.element].append(point.variable.name)
        for exposed in system.exposed:
            inner = resolve_endpoint(exposed.path, system.checked.descriptions)
            used[inner.element].append(inner.variable.name)
        if system.elements:
            parent = SubElement(xml, "ssd:Elements")
            for element in system.elements:
                parent.append(self._element(system, element, used[element.name]))
        self._connections(xml, system)
        note = Xml("uuvsim:System", tick=step_text(system.base_step))
        if system.loops != "iterate":
            note.set("loops", system.loops)
        if system.mismatches != "refuse":
            note.set("mismatches", system.mismatches)
        if system.events:
            note.set("events", "true")
        for group in system.groups:
            item = SubElement(note, "uuvsim:Group", algorithm=group.algorithm)
            if group.algorithm == "iterated":
                item.set("solver", group.solver)
                item.set("tolerance", repr(float(group.tolerance)))
                item.set("limit", str(group.limit))
            for member in group.members:
                SubElement(item, "uuvsim:Member", name=member)
        if system.variable_step is not None:
            note.append(variable_step_xml(system.variable_step))
        if name != system.name:
            note.set("name", system.name)
        if description:
            note.set("description", system.description)
        add_annotation(xml).append(note)
        add_system_step(xml, step_for_others(system))
        return xml

    def _element(self, system: System, element: Element, used: list[str]) -> Xml:
        if not isinstance(element.source, str):
            return self.system(system.nested(element.name), element.name, element.description)
        source, mime = self._source(element.source, system.base)
        file, _, options = source.partition("#")
        implementation = ""
        if file.lower().endswith(".fmu"):  # SSP has an attribute for the interface
            pairs = [p for p in options.split("&") if p]
            chosen = [p.partition("=")[2] for p in pairs if p.startswith("interface=")]
            implementation = chosen[-1] if chosen else ""
            rest = "&".join(p for p in pairs if not p.startswith("interface="))
            source = f"{file}#{rest}" if rest else file
        xml = Xml("ssd:Component", name=element.name, source=quote(source, safe="/:?&=@#~+,;"))
        xml.set("type", mime)
        if implementation:
            xml.set("implementation", implementation)
        if element.description:
            xml.set("description", element.description)
        description = system.checked.descriptions[element.name]
        self._connectors(xml, description, [*used, *element.units])
        if element.start:
            bindings = SubElement(xml, "ssd:ParameterBindings")
            binding = SubElement(bindings, "ssd:ParameterBinding", type=MIME["ssv"])
            values = SubElement(binding, "ssd:ParameterValues")
            items = element.start.items()
            values.append(parameter_set(items, description, self.version, element.name))
            self._use([description.variables[n] for n in element.start], description)
        note = Xml("uuvsim:Component")
        if element.rate is not None:
            note.set("step", step_text(element.rate))
        for name, units in element.units.items():
            if " " in units:  # a connector has one unit only
                SubElement(note, "uuvsim:Units", name=name, units=units)
        if len(note) or note.attrib:
            add_annotation(xml).append(note)
        if element.rate is not None:
            add_component_step(xml, element.rate)
        return xml

    def _source(self, source: str, base: Path | None) -> tuple[str, str]:
        """Return the source, relative to the file's folder, and its MIME type."""
        resolved = resolve(source, base)
        suffix = Path(source.partition("#")[0]).suffix.lower().removeprefix(".")
        mime = MIME.get(resolved.kind, MIME.get(suffix, MIME["other"]))
        file, colon, rest = (
            source.rpartition(":") if resolved.kind == "Python" else (source, "", "")
        )
        here = Path(os.path.abspath(base or Path()))
        there = Path(os.path.abspath(self.folder))
        if source.startswith("model:") and here != there:
            return with_vehicle_paths(source, lambda p: _seen_from(there, here, p)), mime
        is_file = resolved.kind in ("FMU", "system") or file.endswith(".py")
        if not is_file or Path(file).is_absolute():
            return source, mime
        if here != there:
            file = Path(os.path.relpath(here / file, there)).as_posix()
        return f"{file}{colon}{rest}", mime

    def _connectors(self, parent: Xml, description: Description, names: list[str]) -> None:
        """Add the connectors of these names, in the order of the description."""
        wanted = set(names)
        found = [v for v in description.variables.values() if v.name in wanted]
        if not found:
            return
        section = SubElement(parent, "ssd:Connectors")
        self._use(found, description)
        for variable in found:
            if has_arrays(description, self.version):
                self._connector(section, variable, variable.name, variable.shape, variable.unit)
                continue
            for i, name in enumerate(variable.element_names):
                self._connector(section, variable, name, (), variable.unit_of_element(i))

    def _connector(
        self,
        parent: Xml,
        variable: Variable,
        name: str,
        shape: tuple[int, ...],
        unit: str | None,
    ) -> None:
        xml = SubElement(parent, "ssd:Connector", name=name, kind=variable.causality)
        typed = SubElement(xml, f"ssc:{type_name(variable.type, self.version)}")
        if unit and is_float(variable):
            typed.set("unit", unit)
        for extent in shape:
            SubElement(xml, "ssc:Dimension", size=str(extent))

    def _connections(self, parent: Xml, system: System) -> None:
        """Add the connections between elements, then those of exposed connectors."""
        section = Xml("ssd:Connections")
        described = system.checked.descriptions
        for wire in system.checked.wires:
            source, target, c = wire.source, wire.target, wire.connection
            a, b = (has_arrays(described[p.element], self.version) for p in (source, target))
            for i, j in self._pairs(source, target, a and b):
                xml = self._connection(section, [(source, i, a), (target, j, b)])
                if not c.convert:
                    xml.set("suppressUnitConversion", "true")
                if c.table:
                    add_table(xml, c.table)
                elif (c.factor, c.offset) != (1.0, 0.0):
                    numbers = {"factor": number(c.factor), "offset": number(c.offset)}
                    SubElement(xml, "ssc:LinearTransformation", numbers)
        outside = self.version == "2.0"
        interface = system.interface()
        for item in system.exposed:
            inner = resolve_endpoint(item.path, described)
            outer = Endpoint("", *find_variable(item.name, interface))
            inside = has_arrays(described[inner.element], self.version)
            for i, j in self._pairs(outer, inner, inside and outside):
                ends = [(outer, i, outside), (inner, j, inside)]
                if inner.variable.causality == "output":
                    ends.reverse()
                self._connection(section, ends)
        if len(section):
            parent.append(section)

    def _pairs(self, a: Endpoint, b: Endpoint, arrays: bool) -> list[tuple[int | None, int | None]]:
        """Return the pairs of elements to connect; (None, None) stands for whole arrays."""
        if a.whole and b.whole and arrays:
            return [(None, None)]
        return list(zip(a.elements, b.elements, strict=True))

    def _connection(self, section: Xml, ends: list[End]) -> Xml:
        xml = SubElement(section, "ssd:Connection")
        for side, (point, i, arrays) in zip(("start", "end"), ends, strict=True):
            if point.element:
                xml.set(f"{side}Element", point.element)
            name = point.variable.name
            index = "" if i is None else index_text(point.variable.shape, i)
            if arrays:
                xml.set(f"{side}Connector", name)
                if index:
                    xml.set(f"{side}Indices", index[1:-1].replace(",", " "))
            else:
                xml.set(f"{side}Connector", f"{name}{index}")
        return xml

    def _use(self, variables: list[Variable], description: Description) -> None:
        self.units.update(description.units)
        self.unit_names.update(u for v in variables if is_float(v) for u in v.units if u)


def _seen_from(there: Path, here: Path, path: str) -> str:
    """Return the path of a vehicle in the folder `here` as seen from the folder `there`."""
    if Path(path).is_absolute() or path in vehicle_ids() or not is_vehicle_path(here / path):
        return path
    return Path(os.path.relpath(here / path, there)).as_posix()
