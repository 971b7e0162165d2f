"""Parameter mappings (.ssm): from names of a source to names of a target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.orchestrator.parameters.ssp_xml import SspVersion, document, q, read_document
from uuvsim_cosim.orchestrator.values.transformation import Table, read_transformation

__all__ = ["MappingEntry", "read_mapping", "read_names", "read_ssm", "write_ssm"]


@dataclass(frozen=True)
class MappingEntry:
    """Rule by which a target parameter gets its value from a source parameter.

    The target gets factor · source + offset, after conversion into its unit if `convert`. With a
    `table` (Booleans, integers, items of enumerations) it gets the table's entry.
    """

    source: str
    target: str
    factor: float = 1.0
    offset: float = 0.0
    convert: bool = True
    table: Table = ()


def read_ssm(path: Path) -> list[MappingEntry]:
    """Read a mapping file."""
    return read_mapping(read_document(path, "ssm:ParameterMapping"), shown(path))


def read_names(path: Path) -> dict[str, str]:
    """Read a mapping file that only renames; raises InputInvalid if it transforms values."""
    entries = read_ssm(path)
    for entry in entries:
        if entry.table:
            raise InputInvalid(path, f"{entry.source} is mapped by a table of values", "names only")
        if (entry.factor, entry.offset) != (1.0, 0.0):
            raise InputInvalid(
                path,
                f"{entry.source} is transformed by {entry.factor:g} x + {entry.offset:g}",
                "names only (units are converted at the connections)",
            )
    return {e.source: e.target for e in entries}


def read_mapping(root: Element, place: str) -> list[MappingEntry]:
    """Read the element ``ssm:ParameterMapping``."""
    found: list[MappingEntry] = []
    for item in root.iterfind(q("ssm:MappingEntry")):
        source, target = item.get("source"), item.get("target")
        if source == "":
            continue  # no parameter has this name
        if source is None or not target:
            raise InputInvalid(place, "an entry without source or target", "both")
        change = read_transformation(item, f"{place}: <ssm:MappingEntry source={source!r}>")
        found.append(
            MappingEntry(source, target, change.factor, change.offset, change.convert, change.table)
        )
    targets = [e.target for e in found]
    twice = next((t for t in targets if targets.count(t) > 1), None)
    if twice is not None:
        raise InputInvalid(place, f"two entries give {twice!r}", "one")
    return found


def write_ssm(names: Mapping[str, str], path: Path, version: SspVersion = "2.0") -> None:
    """Write a mapping that only renames."""
    root = Element("ssm:ParameterMapping", version=version)
    for source, target in names.items():
        SubElement(root, "ssm:MappingEntry", source=source, target=target)
    path.write_bytes(document(root, "ssm"))
