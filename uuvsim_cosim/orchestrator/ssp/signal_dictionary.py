"""Signal dictionaries (.ssb): named signals with one writer and any number of readers.

A dictionary is resolved into plain connections, from the output that writes an entry to each
input that reads it. A nested system that refers to a dictionary of a system around it gets a
connector for each entry that it writes or reads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element as Xml

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.parameters.ssp_xml import q, read_document
from uuvsim_cosim.orchestrator.ssp.ssd_connections import Border, End, Link, Links, UnitOf, Wanted
from uuvsim_cosim.orchestrator.system.elements import Exposed
from uuvsim_cosim.orchestrator.values.transformation import Transformation, chained

__all__ = ["Dictionary", "read_dictionaries", "read_references", "resolve_signals"]

Dictionary = Mapping[str, str | None]  # the unit of each entry, if it names one
_MIME = "application/x-ssp-signal-dictionary"


def read_dictionaries(
    xml: Xml, folder: Path, confine: Callable[[str, str], None], place: str
) -> dict[str, Dictionary]:
    """Read the dictionaries that a system defines, inline or in a file, which `confine` checks."""
    found: dict[str, Dictionary] = {}
    for item in xml.iterfind(f"{q('ssd:SignalDictionaries')}/{q('ssd:SignalDictionary')}"):
        name = item.get("name", "")
        here = f"{place}<ssd:SignalDictionary name={name!r}>"
        if item.get("type", _MIME) != _MIME:
            raise InputInvalid(here, f"type {item.get('type')!r}", f"{_MIME!r}")
        source = item.get("source")
        if source is None:
            inner = item.find(q("ssb:SignalDictionary"))
            if inner is None:
                raise InputInvalid(here, "neither source nor entries", "one of the two")
        else:
            confine(unquote(source), here)
            path = folder / unquote(source)
            inner, here = read_document(path, "ssb:SignalDictionary"), shown(path)
        if name in found:
            raise InputInvalid(here, "a second dictionary of this name", "one")
        entries: dict[str, str | None] = {}
        for entry in inner.iterfind(q("ssb:DictionaryEntry")):
            key = entry.get("name", "")
            if not key or key in entries:
                raise InputInvalid(here, f"an entry {key!r}", "each name once")
            entries[key] = next((e.get("unit") for e in entry if e.get("unit")), None)
        found[name] = entries
    return found


def read_references(xml: Xml) -> dict[str, str]:
    """Return the name of the dictionary to which each dictionary reference of a system refers."""
    path = f"{q('ssd:Elements')}/{q('ssd:SignalDictionaryReference')}"
    return {e.get("name", ""): e.get("dictionary", "") for e in xml.iterfind(path)}


@dataclass(frozen=True)
class _Use:
    """An endpoint that writes or reads an entry; `index` is that of the entry, if any."""

    end: End
    index: str
    change: Transformation


def resolve_signals(
    links: Links,
    references: Mapping[str, str],
    own: Mapping[str, Dictionary],
    borders: Mapping[str, Border],
    unit_of: UnitOf,
    units: Mapping[str, Unit],
    place: str,
) -> tuple[list[Wanted], list[str]]:
    """Replace connections to dictionaries by plain connections.

    Return the signals that dictionaries around the system must provide, and remarks. Raises
    InputInvalid for an entry that does not exist, or has two writers.
    """
    uses: dict[tuple[str, str, bool], list[_Use]] = {}
    plain: list[Link] = []
    for a, b, change in links.connections:
        if a.element in references and b.element in references:
            raise InputInvalid(
                f"{place}<ssd:Connection> {a.text} to {b.text}",
                "between two dictionaries",
                "a component at one of its ends",
            )
        if a.element in references:
            key = (references[a.element], a.connector, False)
            uses.setdefault(key, []).append(_Use(b, a.index, change))
        elif b.element in references:
            key = (references[b.element], b.connector, True)
            uses.setdefault(key, []).append(_Use(a, b.index, change))
        else:
            plain.append((a, b, change))
    for item in links.exposed:
        if any(item.path.startswith(f"{r}.") for r in references):
            raise InputInvalid(
                f"{place}<ssd:Connection> {item.name} to {item.path}",
                "from the system's own connector to a dictionary",
                "a component",
            )
    for element, border in borders.items():
        for w in border.signals:
            use = _Use(End(element, w.connector), "", w.change)
            uses.setdefault((w.dictionary, w.entry, w.writes), []).append(use)
    links.connections[:] = plain
    outward, remarks = [], []
    for (name, entry, writes), found in uses.items():
        if name not in own:
            outward += _outward(links, name, entry, writes, found)
            continue
        here = f"{place}dictionary {name!r}"
        if entry not in own[name]:
            expected = expected_names(entry, list(own[name]), "one of its entries")
            raise InputInvalid(here, f"no entry {entry!r}", expected)
        if writes:
            continue
        writers = uses.get((name, entry, True), [])
        if not writers:
            remarks.append(f"{here}: nothing writes {entry!r}; its readers keep their start values")
        joined = _joined(
            writers, found, own[name][entry], unit_of, units, f"{here}, entry {entry!r}"
        )
        links.connections += joined
    return outward, remarks


def _joined(
    writers: list[_Use],
    readers: list[_Use],
    unit: str | None,
    unit_of: UnitOf,
    units: Mapping[str, Unit],
    place: str,
) -> list[Link]:
    """Return the connections from the writers of an entry to its readers."""
    indices = [w.index for w in writers]
    if len(set(indices)) < len(indices) or ("" in indices and len(indices) > 1):
        names = " and ".join(w.end.text for w in writers)
        raise InputInvalid(place, f"written by {names}", "one output")
    found: list[Link] = []
    for reader in readers:
        for writer in writers:
            if writer.index != reader.index and writer.index and reader.index:
                continue  # another element
            source = _element(writer.end, reader.index if not writer.index else "")
            target = _element(reader.end, writer.index if not reader.index else "")
            named = (unit_of(source), unit, unit_of(target))
            found.append((source, target, chained(writer.change, reader.change, named, units)))
    return found


def _element(end: End, index: str) -> End:
    return End(end.element, end.connector, end.index or index)


def _outward(
    links: Links, dictionary: str, entry: str, writes: bool, uses: list[_Use]
) -> list[Wanted]:
    """Add a connector to the system for each use of an entry of an outer system."""
    found: list[Wanted] = []
    for use in uses:
        used = {x.name for x in links.exposed}
        stem = "".join(c if c.isalnum() or c == "_" else "_" for c in f"{dictionary}_{entry}")
        name, n = stem, 1
        while name in used:
            n += 1
            name = f"{stem}_{n}"
        links.exposed.append(Exposed(name, use.end.text))
        found.append(Wanted(dictionary, f"{entry}", writes, name, use.change))
        if use.index:
            raise InputInvalid(
                use.end.text,
                f"one element, {use.index}, of an entry of a dictionary around its system",
                "the whole entry",
            )
    return found
