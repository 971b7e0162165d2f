"""Parser for XML from untrusted files: document types, and therefore entities, are refused."""

from __future__ import annotations

import codecs
import re
from pathlib import Path
from xml.etree import ElementTree

from uuvsim_cosim.errors import FmuError, UuvsimError

__all__ = ["parse_xml", "read_xml"]

_ENCODING = re.compile(rb"^\s*<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)[\"']")
_DECLARATION = re.compile(r"^\s*<\?xml[^>]*\?>")
_ENTITY_TRICK = re.compile(r"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)
_ENCODINGS = {"utf-8", "utf-16", "ascii", "iso8859-1", "cp1252"}


def read_xml(
    path: Path, error: type[UuvsimError] = FmuError, place: str | None = None
) -> ElementTree.Element:
    """Read an XML file, which errors call `place` (default: its path); see `parse_xml`."""
    place = place or str(path)
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise error(f"{place}: cannot be read ({problem.strerror})") from None
    return parse_xml(data, place, error)


def parse_xml(data: bytes, place: str, error: type[UuvsimError] = FmuError) -> ElementTree.Element:
    """Parse a document; raises `error`, with the place, if it is malformed or declares entities."""
    text = _decode(data, place, error)
    if _ENTITY_TRICK.search(text):
        raise error(
            f"{place}: declares a document type or entities; expected plain XML without <!DOCTYPE"
        )
    text = _DECLARATION.sub("", text, count=1)
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as problem:
        raise error(f"{place}: malformed XML ({problem})") from None


def _decode(data: bytes, place: str, error: type[UuvsimError]) -> str:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        name = "utf-16"
    elif data.startswith(codecs.BOM_UTF8):
        name, data = "utf-8", data[len(codecs.BOM_UTF8) :]
    else:
        match = _ENCODING.match(data)
        name = match[1].decode() if match else "utf-8"
    try:
        known = codecs.lookup(name).name
        if known not in _ENCODINGS:
            raise LookupError
        return data.decode(known)
    except LookupError:
        raise error(f"{place}: encoding {name!r}; expected UTF-8") from None
    except UnicodeDecodeError as problem:
        raise error(f"{place}: is not {name} ({problem.reason}); expected UTF-8") from None
