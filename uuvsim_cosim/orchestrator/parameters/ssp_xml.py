"""XML that all files of SSP share: namespaces, units, typed elements, this project's annotation.

SSP 2.0 kept the namespaces of 1.0; a file's `version` distinguishes them. Arrays and the types of
FMI 3.0 exist in 2.0 only; in 1.0 an array is written element by element, as ``tau[1]``.

Data that SSP does not define is in annotations of type ``org.uuvsim.cosim``: on the system
``<uuvsim:System tick="0.01"><uuvsim:Group algorithm="…"><uuvsim:Member name="…"/>``, and on a
component ``<uuvsim:Component step="0.02"/>``, both in s. Readers that do not know them see
plain SSP. Steps are repeated in the annotations of other tools (see `ssp/annotations.py`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Description, VariableType
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.fmus.importer.safe_xml import parse_xml
from uuvsim_cosim.models.declaration.units import BASE, Unit
from uuvsim_cosim.orchestrator.values.values import unit_named
from uuvsim_cosim.orchestrator.values.xml_values import float_of, int_of, number

__all__ = [
    "ANNOTATION",
    "MIME",
    "NAMESPACES",
    "SspVersion",
    "add_annotation",
    "add_units",
    "annotations_of",
    "document",
    "find_annotation",
    "has_arrays",
    "q",
    "read_document",
    "read_units",
    "type_name",
]

SspVersion = Literal["1.0", "2.0"]
ANNOTATION = "org.uuvsim.cosim"
NAMESPACES = {
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "ssb": "http://ssp-standard.org/SSP1/SystemStructureSignalDictionary",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "uuvsim": "urn:uuvsim:cosim:1",
}
MIME = {
    "FMU": "application/x-fmu-sharedlibrary",
    "model": "application/vnd.uuvsim.model",
    "Python": "application/vnd.uuvsim.python",
    "table": "text/csv",
    "ssd": "application/x-ssp-definition",
    "ssp": "application/x-ssp-package",
    "ssv": "application/x-ssp-parameter-set",
    "other": "application/vnd.uuvsim.source",
}
_ROOT = re.compile(rb"<[A-Za-z_][\w.:-]*")  # the first start tag
_SCALAR_TYPES = {"Float64": "Real", "Float32": "Real", "Boolean": "Boolean", "String": "String",
                 "Binary": "Binary"}  # fmt: skip


def q(name: str) -> str:
    """Expand ``ssd:System`` to the tag that ElementTree reads."""
    prefix, _, local = name.partition(":")
    return f"{{{NAMESPACES[prefix]}}}{local}"


_ANNOTATIONS = f"{q('ssd:Annotations')}/{q('ssc:Annotation')}"


def document(root: Element, *prefixes: str) -> bytes:
    """Write a tree of literal prefixed tags as a UTF-8 document; equal trees give equal bytes."""
    for prefix in prefixes:
        root.set(f"xmlns:{prefix}", NAMESPACES[prefix])
    indent(root, "  ")
    text = tostring(root, encoding="unicode", short_empty_elements=True)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def type_name(type_: VariableType, version: SspVersion) -> str:
    """Return SSP's name of a type: FMI 3.0's in 2.0; Real, Integer, … in 1.0."""
    if version == "2.0":
        # An enumeration must name its definition, which a description does not keep.
        return "Int64" if type_ == "Enumeration" else type_
    return _SCALAR_TYPES.get(type_, "Integer")


def has_arrays(description: Description, version: SspVersion) -> bool:
    """Return whether arrays are written whole: SSP 1.0 has none, nor do FMI 1.0 and FMI 2.0."""
    return version == "2.0" and description.kind not in ("FMI 1.0", "FMI 2.0")


def add_units(parent: Element, names: Iterable[str], units: Mapping[str, Unit], tag: str) -> None:
    """Define the units that a file refers to; an unknown unit is written without dimension."""
    listed = sorted(set(names))
    if not listed:
        return
    section = SubElement(parent, tag)
    for name in listed:
        unit = unit_named(name, units) or Unit(name, (0,) * len(BASE))
        base = {b: str(e) for b, e in zip(BASE, unit.exponents, strict=True) if e}
        if unit.factor != 1.0:
            base["factor"] = number(unit.factor)
        if unit.offset != 0.0:
            base["offset"] = number(unit.offset)
        SubElement(SubElement(section, "ssc:Unit", name=name), "ssc:BaseUnit", base)


def read_units(parent: Element, tag: str, place: str = "units") -> dict[str, Unit]:
    """Read the units that a file defines."""
    found: dict[str, Unit] = {}
    for item in parent.iterfind(f"{q(tag)}/{q('ssc:Unit')}"):
        base = item.find(q("ssc:BaseUnit"))
        name = item.get("name", "")
        if base is None:
            continue  # a name without a definition; our own table may know it
        here = f"{place}: <ssc:Unit name={name!r}>"
        exponents = tuple(int_of(base, b, here, 0) for b in BASE)
        factor, offset = float_of(base, "factor", here, 1.0), float_of(base, "offset", here, 0.0)
        if factor == 0.0:
            raise InputInvalid(here, "factor 0", "another number")
        found[name] = Unit(name, exponents, factor, offset)
    return found


def add_annotation(parent: Element, type_: str = ANNOTATION) -> Element:
    """Add an empty annotation of a tool, by default of this project, and return it."""
    section = parent.find("ssd:Annotations")
    if section is None:
        section = SubElement(parent, "ssd:Annotations")
    return SubElement(section, "ssc:Annotation", type=type_)


def annotations_of(parent: Element | None, type_: str = ANNOTATION) -> Iterator[Element]:
    """Yield the annotations of a tool."""
    for item in () if parent is None else parent.iterfind(_ANNOTATIONS):
        if item.get("type") == type_:
            yield item


def find_annotation(parent: Element) -> Element | None:
    """Find the content of this project's annotation."""
    return next((item[0] for item in annotations_of(parent) if len(item)), None)


def read_document(path: Path, root: str, remarks: list[str] | None = None) -> Element:
    """Parse a file of SSP, which must have this root, ``ssd:…``; raises InputInvalid.

    If a prefix of SSP is used but not declared, SSP's namespace is assumed, with a remark: tools
    that ignore namespaces write and read such files.
    """
    place = shown(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        what = f"an .{root.partition(':')[0]} file"
        raise InputInvalid(place, error.strerror, what) from None
    try:
        found = parse_xml(data, place, InputInvalid)
    except InputInvalid as error:
        missing = [
            p for p in NAMESPACES
            if f"<{p}:".encode() in data and f"xmlns:{p}".encode() not in data
        ]  # fmt: skip
        if "unbound prefix" not in str(error) or not missing:
            raise
        names = "".join(f' xmlns:{p}="{NAMESPACES[p]}"' for p in missing)
        data = _ROOT.sub(lambda m: m[0] + names.encode(), data, count=1)
        found = parse_xml(data, place, InputInvalid)
        if remarks is not None:
            listed = ", ".join(missing)
            remarks.append(f"prefix {listed} without a namespace is read as SSP's")
    if found.tag != q(root):
        tag = found.tag.rpartition("}")[2]
        raise InputInvalid(place, f"<{tag}>", f"<{root}>")
    return found
