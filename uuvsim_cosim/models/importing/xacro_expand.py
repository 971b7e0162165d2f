"""Xacro's macros put in the place of their calls, with conditions, blocks and scopes of properties.

A macro that nobody calls (a file that only defines a vehicle) is left out, unless it alone holds
a link with an inertial, or the hydrodynamics: then its body counts as it stands.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import TYPE_CHECKING

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.importing.xacro_text import evaluated, is_included, is_xacro, local, truth

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["expand"]

_DEEPEST = 40  # calls inside calls
_MOST = 100_000  # elements


@dataclass(frozen=True)
class _Scope:
    """What names stand for: properties (texts) and blocks (elements); and all macros known."""

    properties: dict[str, str]
    blocks: dict[str, list[_Element]]
    macros: dict[str, _Element]
    called: set[str]
    top: dict[str, str]  # the properties of the whole file
    depth: int = 0


def expand(root: _Element, place: str) -> None:
    """Expand a tree, includes already in place; raises InputInvalid where a macro calls itself."""
    known = {"pi": repr(math.pi), "None": "None"}
    for element in root.iter():  # so that a body that stands uncalled knows those of later lines
        value = None
        if is_xacro(element, "property"):
            value = element.get("value")
        elif is_xacro(element, "arg"):
            value = element.get("default")
        if value is not None:
            known.setdefault(element.get("name") or "", value)
    scope = _Scope(known, {}, {}, set(), known)
    _children(root, scope, place)
    _uncalled(root, scope, place)


def _children(parent: _Element, scope: _Scope, place: str) -> None:
    for element in list(parent):
        if isinstance(element.tag, str):
            _element(parent, element, scope, place)


def _element(parent: _Element, element: _Element, scope: _Scope, place: str) -> None:
    """Expand one element in its place."""
    if not (is_xacro(element, local(element))):
        for key, value in element.attrib.items():
            if "$" in value:
                element.set(key, evaluated(value, scope.properties))
        if element.text and "$" in element.text:
            element.text = evaluated(element.text, scope.properties)
        _children(element, scope, place)
        return
    name = local(element)
    if name == "call":
        name = evaluated(element.get("macro") or "", scope.properties)
    if name == "property":
        _define(element, scope)
    elif name == "macro":
        scope.macros[_name(element)] = element
        return  # it stays until it is known whether somebody calls it
    elif name in ("if", "unless"):
        wanted = truth(element.get("value") or "", scope.properties)
        if wanted is not None and wanted == (name == "if"):
            _children(element, scope, place)
            _replace(parent, element, list(element))
            return
    elif name == "insert_block":
        inner = deepcopy(scope.blocks.get(evaluated(element.get("name") or "", scope.properties)))
        _replace(parent, element, inner or [])
        return
    elif name in scope.macros:
        _call(parent, element, name, scope, place)
        return
    _replace(parent, element, [])


def _define(element: _Element, scope: _Scope) -> None:
    name, value = element.get("name") or "", element.get("value")
    if value is None and element.get("default") is not None:
        value = scope.properties.get(name, element.get("default"))
    if value is None:
        scope.blocks[name] = list(element)
        return
    wide = element.get("scope") in ("global", "parent")
    for properties in [scope.properties] + [scope.top] * wide:
        # A property that names itself means its value until now.
        properties[name] = evaluated(value, scope.properties) if f"{name}" in value else value


def _call(parent: _Element, element: _Element, name: str, scope: _Scope, place: str) -> None:
    """Put a macro's body in the place of its call."""
    if scope.depth >= _DEEPEST:
        raise InputInvalid(
            f"{place}:{element.sourceline}",
            f"<xacro:{name}>: macros call each other {_DEEPEST} deep",
            "an end",
        )
    scope.called.add(name)
    given = {k: evaluated(v, scope.properties) for k, v in element.attrib.items()}
    _children(element, scope, place)
    inner = [e for e in element if isinstance(e.tag, str)]
    properties, blocks = {**scope.top}, {**scope.blocks}
    macro = scope.macros[name]
    for word in _parameters(macro):
        key, default = _split(word)
        if key.startswith("*"):
            block = inner.pop(0) if inner else None
            contents = [] if block is None else list(block) if key.startswith("**") else [block]
            blocks[key.lstrip("*")] = contents
        elif key in given:
            properties[key] = given[key]
        elif default is not None and default.startswith("^"):
            properties[key] = scope.properties.get(key, default[1:].lstrip("|"))
        elif default is not None:
            properties[key] = evaluated(default, scope.properties)
        else:
            properties.pop(key, None)
    body = deepcopy(macro)
    inside = _Scope(properties, blocks, scope.macros, scope.called, scope.top, scope.depth + 1)
    _children(body, inside, place)
    _replace(parent, element, list(body))
    if sum(1 for _ in parent.getroottree().iter()) > _MOST:
        raise InputInvalid(place, f"macros make more than {_MOST} elements", "a vehicle")


def _parameters(macro: _Element) -> Sequence[str]:
    text = macro.get("params") or ""
    try:
        return shlex.split(text, posix=False)
    except ValueError:
        return text.split()


def _split(word: str) -> tuple[str, str | None]:
    """Return a parameter's name and default: ``a:=1``, ``a:='1 2'``, ``a=1``; none without."""
    key, sign, default = word.partition(":=") if ":=" in word else word.partition("=")
    return key, default.strip("'\"") if sign else None


def _replace(parent: _Element, element: _Element, new: Sequence[_Element]) -> None:
    at = parent.index(element)
    for k, e in enumerate(new):
        parent.insert(at + k, e)
    parent.remove(element)


def _uncalled(root: _Element, scope: _Scope, place: str) -> None:
    """Drop macros, but put in place those that alone hold what a vehicle is made of."""
    macros = [e for e in root.iter() if is_xacro(e, "macro")]
    outside = [e for e in root.iter() if not any(is_xacro(a, "macro") for a in e.iterancestors())]
    lacking = [has for has in (_has_inertial, _has_water) if not any(map(has, outside))]
    for of_main_file in (True, False):
        called: set[str] = set()
        bodies = {}
        for macro in macros:
            if is_included(macro) == of_main_file or _name(macro) in scope.called:
                continue
            own = {k: v for k, v in map(_split, _parameters(macro)) if v is not None}
            properties = {**scope.top, **own}
            bodies[id(macro)] = body = deepcopy(macro)
            _children(body, _Scope(properties, {}, scope.macros, called, scope.top), place)
        for has in list(lacking):
            for macro in macros:
                inside = bodies.get(id(macro))
                if inside is None or _name(macro) in called or not any(map(has, inside.iter())):
                    continue
                if has in lacking:
                    lacking.remove(has)
                parent = macro.getparent()
                if parent is not None:
                    _replace(parent, macro, list(inside))
                    del bodies[id(macro)]
    for macro in macros:
        parent = macro.getparent()
        if parent is not None:
            parent.remove(macro)


def _name(macro: _Element) -> str:
    return (macro.get("name") or "").removeprefix("xacro:")


def _has_inertial(element: _Element) -> bool:
    above = element.getparent()
    return local(element) == "inertial" and above is not None and local(above) == "link"


def _has_water(element: _Element) -> bool:
    return local(element) == "hydrodynamic_model" or (
        local(element) == "plugin" and "hydrodynamics" in (element.get("filename") or "").lower()
    )
