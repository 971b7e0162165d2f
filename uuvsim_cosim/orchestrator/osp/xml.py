"""XML of the Open Simulation Platform: each mistake is a problem with its file and place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.fmus.importer.safe_xml import read_xml
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.values.xml_values import local_name

__all__ = ["Reading", "children", "opened"]


@dataclass
class Reading:
    """Problems and remarks of a file, gathered while it is read."""

    file: str
    problems: list[Problem] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def wrong(self, place: str, read: str, expected: str) -> None:
        """Note a problem."""
        self.problems.append(Problem(f"{self.file}: {place}", read, expected))

    def remark(self, text: str) -> None:
        """Note a remark for the user."""
        if text not in self.remarks:
            self.remarks.append(f"{self.file}: {text}")

    def required(self, xml: Xml, attribute: str, place: str, what: str) -> str:
        """Return a required attribute; note a problem and return "" if it is missing."""
        text = xml.get(attribute, "")
        if not text:
            self.wrong(place, f"no {attribute}", f'{attribute}="…", {what}')
        return text

    def number(self, text: str | None, place: str, what: str, default: float) -> float:
        """Read a finite number."""
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        self.wrong(place, f"{what} {text!r}", "a number such as 0.01")
        return default

    def count(self, xml: Xml, attribute: str, place: str) -> int:
        """Read a count, at least one."""
        text = xml.get(attribute, "")
        if text.strip().isdecimal() and 0 < int(text) <= 10_000:
            return int(text)
        self.wrong(place, f"{attribute} {text!r}", "a whole number from 1 to 10000")
        return 1

    def known(self, name: str, names: list[str], place: str, what: str) -> bool:
        """Return whether a name is one of the known names; note a problem if it is not."""
        if name in names:
            return True
        if name:
            self.wrong(place, f"no {what} {name!r}", expected_names(name, names, f"a {what}"))
        return False


def opened(path: Path, root: str) -> Xml:
    """Parse a file, which must have this root; raises InputInvalid."""
    found = read_xml(path, InputInvalid, shown(path))
    if local_name(found) != root:
        raise InputInvalid(shown(path), f"<{local_name(found)}>", f"<{root}>")
    return found


def children(xml: Xml | None, *names: str) -> Iterator[Xml]:
    """List the children, or those of some names."""
    for child in xml if xml is not None else ():
        if not names or local_name(child) in names:
            yield child
