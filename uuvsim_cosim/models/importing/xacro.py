"""A robot description (URDF, SDF, xacro) as one XML tree: files included, macros expanded.

Values replace `${...}`, with conditions, blocks and scopes of properties. An expression that cannot
be evaluated (`${namespace}`) stays as it is. The reader of a number refuses it. A macro that nobody
calls (a file that only defines a vehicle) is left out, unless it alone holds a link with an
inertial, or the hydrodynamics: then its body counts as if it were called.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["expand", "is_xacro", "local", "near", "place_of", "read_description"]

_MOST_FILES = 50
_DEEPEST = 40  # calls inside calls
_MOST = 100_000  # elements
_EXPRESSION = re.compile(r"\$\{([^{}]*)\}")
_OPERATIONS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_FUNCTIONS: dict[str, Callable[..., float]] = {
    **{n: getattr(math, n) for n in ("sin", "cos", "tan", "sqrt", "radians", "degrees", "atan2")},
    "abs": abs,
    "min": min,
    "max": max,
    "float": float,
    "int": int,
}
_UNKNOWN = (
    SyntaxError, ValueError, KeyError, ZeroDivisionError, TypeError, OverflowError, RecursionError
)  # fmt: skip
_INCLUDED_FROM = "{urn:uuvsim}file"  # of an element that was included


def local(element: _Element) -> str:
    """Return an element's name without its namespace; empty for a comment."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def is_xacro(element: _Element, name: str) -> bool:
    """Return whether an element is xacro's of that name."""
    return isinstance(element.tag, str) and "xacro" in element.tag and local(element) == name


def place_of(path: Path, element: _Element) -> str:
    """Return file and line of an element, which may stand in a file that was included."""
    return f"{element.get(_INCLUDED_FROM) or path}:{element.sourceline}"


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
                e.set(_INCLUDED_FROM, str(found))
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


def _evaluated(text: str, properties: dict[str, str], depth: int = 0) -> str:
    """Put values in the place of ${...}; what cannot be evaluated stays."""
    if depth > 20:
        return text

    def one(match: re.Match[str]) -> str:
        inner = match[1].strip()
        if inner in properties:
            return _evaluated(properties[inner], properties, depth + 1)
        try:
            value = _value(ast.parse(inner, mode="eval").body, properties, depth)
        except _UNKNOWN:
            return match[0]
        return value if isinstance(value, str) else repr(value)

    text = re.sub(r"\$\(arg (\w+)\)", r"${\1}", text)
    return _EXPRESSION.sub(one, text)


def _truth(text: str, properties: dict[str, str]) -> bool | None:
    """Return the value of a condition, None if it is not known."""
    value = _evaluated(text, properties).strip().lower()
    if value in ("true", "false"):
        return value == "true"
    try:
        return float(value) != 0.0
    except ValueError:
        return None


def _value(node: ast.AST, properties: dict[str, str], depth: int) -> Any:
    """Return the number, text or truth value of an expression."""

    def inner(n: ast.AST) -> Any:
        return _value(n, properties, depth)

    match node:
        case ast.Constant(value=bool() | int() | float() | str()):
            return node.value
        case ast.Name(id="True" | "False"):
            return node.id == "True"
        case ast.Name():
            text = _evaluated(properties[node.id], properties, depth + 1)
            if "$" in text:
                raise ValueError(text)
            if text.strip().lower() in ("true", "false"):
                return text.strip().lower() == "true"
            try:
                return float(text)
            except ValueError:
                return text
        case ast.BinOp():
            return _OPERATIONS[type(node.op)](inner(node.left), inner(node.right))
        case ast.UnaryOp():
            return _OPERATIONS[type(node.op)](inner(node.operand))
        case ast.BoolOp():
            values = [bool(inner(n)) for n in node.values]
            return all(values) if isinstance(node.op, ast.And) else any(values)
        case ast.Compare(ops=[op], comparators=[right]):
            return _OPERATIONS[type(op)](inner(node.left), inner(right))
        case ast.IfExp():
            return inner(node.body) if inner(node.test) else inner(node.orelse)
        case ast.Call(func=ast.Attribute(attr=name) | ast.Name(id=name)):
            return _FUNCTIONS[name](*(inner(a) for a in node.args))
        case ast.Attribute(attr="pi"):
            return math.pi
    raise ValueError(ast.dump(node))


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
    for element in root.iter():  # so that the body of an uncalled macro knows those of later lines
        value = None
        if is_xacro(element, "property"):
            value = element.get("value")
        elif is_xacro(element, "arg"):
            value = element.get("default")
        if value is not None:
            known.setdefault(element.get("name") or "", value)
    scope = _Scope(known, {}, {}, set(), known)
    _expand_children(root, scope, place)
    _expand_uncalled(root, scope, place)


def _expand_children(parent: _Element, scope: _Scope, place: str) -> None:
    """Expand each child of an element in its place."""
    for element in list(parent):
        if not isinstance(element.tag, str):
            continue
        name = local(element)
        if not is_xacro(element, name):
            for key, value in element.attrib.items():
                if "$" in value:
                    element.set(key, _evaluated(value, scope.properties))
            if element.text and "$" in element.text:
                element.text = _evaluated(element.text, scope.properties)
            _expand_children(element, scope, place)
            continue
        if name == "call":
            name = _evaluated(element.get("macro") or "", scope.properties)
        new: list[_Element] = []
        if name == "property":
            _define(element, scope)
        elif name == "macro":
            scope.macros[_name(element)] = element
            continue  # it stays until it is known whether it is called
        elif name in ("if", "unless"):
            wanted = _truth(element.get("value") or "", scope.properties)
            if wanted is not None and wanted == (name == "if"):
                _expand_children(element, scope, place)
                new = list(element)
        elif name == "insert_block":
            block = _evaluated(element.get("name") or "", scope.properties)
            new = deepcopy(scope.blocks.get(block, []))
        elif name in scope.macros:
            new = _called(parent, element, name, scope, place)
        _replace(parent, element, new)


def _define(element: _Element, scope: _Scope) -> None:
    """Define a property: a text, or a block of elements."""
    name, value = element.get("name") or "", element.get("value")
    if value is None and element.get("default") is not None:
        value = scope.properties.get(name, element.get("default"))
    if value is None:
        scope.blocks[name] = list(element)
        return
    # A property that names itself means its value until now.
    text = _evaluated(value, scope.properties) if name in value else value
    scope.properties[name] = text
    if element.get("scope") in ("global", "parent"):
        scope.top[name] = text


def _called(
    parent: _Element, element: _Element, name: str, scope: _Scope, place: str
) -> list[_Element]:
    """Return the body of a macro that replaces its call."""
    if scope.depth >= _DEEPEST:
        raise InputInvalid(
            f"{place}:{element.sourceline}",
            f"<xacro:{name}>: macros call each other {_DEEPEST} deep",
            "an end",
        )
    scope.called.add(name)
    given = {k: _evaluated(v, scope.properties) for k, v in element.attrib.items()}
    _expand_children(element, scope, place)
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
            properties[key] = _evaluated(default, scope.properties)
        else:
            properties.pop(key, None)
    body = deepcopy(macro)
    inside = _Scope(properties, blocks, scope.macros, scope.called, scope.top, scope.depth + 1)
    _expand_children(body, inside, place)
    size = sum(1 for root in (parent.getroottree(), body) for _ in root.iter())
    if size > _MOST:
        raise InputInvalid(place, f"macros make more than {_MOST} elements", "a vehicle")
    return list(body)


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


def _expand_uncalled(root: _Element, scope: _Scope, place: str) -> None:
    """Drop macros, but put in place those that alone hold a part of a vehicle."""
    macros = [e for e in root.iter() if is_xacro(e, "macro")]
    outside = [e for e in root.iter() if not any(is_xacro(a, "macro") for a in e.iterancestors())]
    present = set(map(_part, outside))
    lacking = [part for part in ("inertial", "hydrodynamics") if part not in present]
    for of_main_file in (True, False):
        called: set[str] = set()
        bodies = {}
        for macro in macros:
            is_of_main_file = macro.get(_INCLUDED_FROM) is None
            if is_of_main_file != of_main_file or _name(macro) in scope.called:
                continue
            own = {k: v for k, v in map(_split, _parameters(macro)) if v is not None}
            properties = {**scope.top, **own}
            bodies[id(macro)] = body = deepcopy(macro)
            _expand_children(body, _Scope(properties, {}, scope.macros, called, scope.top), place)
        for part in list(lacking):
            for macro in macros:
                inside = bodies.get(id(macro))
                if inside is None or _name(macro) in called:
                    continue
                if part not in map(_part, inside.iter()):
                    continue
                if part in lacking:
                    lacking.remove(part)
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


def _part(element: _Element) -> str:
    """Return which part of a vehicle an element is, empty if none."""
    above = element.getparent()
    if local(element) == "inertial" and above is not None and local(above) == "link":
        return "inertial"
    is_plugin = local(element) == "plugin"
    if local(element) == "hydrodynamic_model" or (
        is_plugin and "hydrodynamics" in (element.get("filename") or "").lower()
    ):
        return "hydrodynamics"
    return ""
