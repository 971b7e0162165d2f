"""Parameter mappings (.ssm): from names of a source to names of a target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.orchestrator.parameters.ssp_xml import SspVersion, document, q, read_document
from uuvsim_cosim.orchestrator.values.transformation import Transformation, read_transformation

__all__ = ["MappingEntry", "read_mapping", "read_names", "read_ssm", "write_ssm"]


@dataclass(frozen=True)
class MappingEntry:
    """Rule by which a target parameter gets its value from a source parameter."""

    source: str
    target: str
    change: Transformation


def read_ssm(path: Path) -> list[MappingEntry]:
    """Read a mapping file."""
    return read_mapping(read_document(path, "ssm:ParameterMapping"), shown(path))


def read_names(path: Path) -> dict[str, str]:
    """Read a mapping file that only renames; raises InputInvalid if it transforms values."""
    entries = read_ssm(path)
    for entry in entries:
        change = entry.change
        if change.table:
            raise InputInvalid(path, f"{entry.source} is mapped by a table of values", "names only")
        if change.scales:
            raise InputInvalid(
                path,
                f"{entry.source} is transformed by {change.factor:g} x + {change.offset:g}",
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
        here = f"{place}: <ssm:MappingEntry source={source!r}>"
        found.append(MappingEntry(source, target, read_transformation(item, here)))
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
