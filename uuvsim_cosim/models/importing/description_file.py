"""A robot description (URDF, SDF, xacro) as one XML tree: files included, macros expanded."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.importing.xacro_expand import expand
from uuvsim_cosim.models.importing.xacro_text import INCLUDED_FROM, is_xacro

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["near", "place_of", "read_description"]

_MOST_FILES = 50


def place_of(path: Path, element: _Element) -> str:
    """Return file and line of an element, which may stand in a file that was included."""
    return f"{element.get(INCLUDED_FROM) or path}:{element.sourceline}"


def read_description(path: Path) -> _Element:
    """Read a file and what it includes into one tree, texts resolved; raises InputInvalid."""
    seen: list[Path] = []
    root = _parsed(path)
    _include(root, path, seen)
    expand(root, str(path))
    return root


def _parsed(path: Path) -> _Element:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        return etree.fromstring(path.read_bytes(), parser)
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be read: {error.strerror}") from None
    except etree.XMLSyntaxError as error:
        line = error.lineno or 1
        raise InputInvalid(f"{path}:{line}", error.msg, "XML (.urdf, .sdf, .xacro)") from None


def _include(root: _Element, path: Path, seen: list[Path]) -> None:
    """Put the children of each included file that lies near in the place of its include."""
    seen.append(path.resolve())
    for element in list(root.iter()):
        parent = element.getparent()
        if parent is None or not is_xacro(element, "include"):
            continue
        found = next(near(element.get("filename") or "", path), None)
        if found is None or found.resolve() in seen or len(seen) >= _MOST_FILES:
            continue
        inner = _parsed(found)
        for e in inner.iter():
            if isinstance(e.tag, str):
                e.set(INCLUDED_FROM, str(found))
        _include(inner, found, seen)
        at = parent.index(element)
        for k, child in enumerate(list(inner)):
            parent.insert(at + 1 + k, child)


def near(name: str, path: Path) -> Iterator[Path]:
    """Yield the files that a name may mean: `$(find package)/urdf/a.xacro` by its last parts."""
    plain = re.sub(r"\$\([^)]*\)", "", re.sub(r"^\w+://", "", name)).lstrip("/")
    if not plain or "$" in plain:
        return
    parts = Path(plain).parts
    for base in (path.parent, *list(path.parent.parents)[:2]):
        for k in range(len(parts)):
            candidate = base.joinpath(*parts[k:])
            if candidate.is_file():
                yield candidate
