"""An XML description of a robot, with what xacro's properties and includes say put in place.

Properties, arithmetic, conditions and includes found beside the file; macros are `xacro_expand`'s.
What stays unknown (`${namespace}`) stays as it is; who needs a number there refuses.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "evaluated",
    "is_included",
    "is_xacro",
    "local",
    "near",
    "place_of",
    "read_description",
    "truth",
]

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
_MOST_FILES = 50
_FILE = "{urn:uuvsim}file"  # of an element that was included


def local(element: Any) -> str:
    """Give an element's name without its namespace; empty for a comment."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def place_of(path: Path, element: Any) -> str:
    """Give file and line of an element, which may stand in a file that was included."""
    return f"{element.get(_FILE) or path}:{element.sourceline}"


def is_included(element: Any) -> bool:
    """Say whether an element stands in a file that was included."""
    return element.get(_FILE) is not None


def read_description(path: Path) -> Any:
    """Read a file and what it includes into one tree, texts resolved; raises InputInvalid."""
    seen: list[Path] = []
    root = _parsed(path)
    _include(root, path, seen)
    from uuvsim_cosim.models.xacro_expand import expand

    expand(root, str(path))
    return root


def _parsed(path: Path) -> Any:
    from lxml import etree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        return etree.fromstring(path.read_bytes(), parser)
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be read: {error.strerror}") from None
    except etree.XMLSyntaxError as error:
        line = error.lineno or 1
        raise InputInvalid(
            f"{path}:{line}: {error.msg}; expected XML (.urdf, .sdf, .xacro)"
        ) from None


def is_xacro(element: Any, name: str) -> bool:
    """Say whether an element is xacro's of that name."""
    return isinstance(element.tag, str) and "xacro" in element.tag and local(element) == name


def _include(root: Any, path: Path, seen: list[Path]) -> None:
    """Put the children of each included file that lies near in the place of its include."""
    seen.append(path.resolve())
    for element in list(root.iter()):
        if not is_xacro(element, "include"):
            continue
        found = next(near(element.get("filename") or "", path), None)
        if found is None or found.resolve() in seen or len(seen) >= _MOST_FILES:
            continue
        inner = _parsed(found)
        for e in inner.iter():
            if isinstance(e.tag, str):
                e.set(_FILE, str(found))
        _include(inner, found, seen)
        parent = element.getparent()
        at = parent.index(element)
        for k, child in enumerate(list(inner)):
            parent.insert(at + 1 + k, child)


def near(name: str, path: Path) -> Iterator[Path]:
    """Give the files that a name may mean: `$(find package)/urdf/a.xacro` by its last parts."""
    plain = re.sub(r"\$\([^)]*\)", "", re.sub(r"^\w+://", "", name)).lstrip("/")
    if not plain or "$" in plain:
        return
    parts = Path(plain).parts
    for base in (path.parent, *list(path.parent.parents)[:2]):
        for k in range(len(parts)):
            candidate = base.joinpath(*parts[k:])
            if candidate.is_file():
                yield candidate


def evaluated(text: str, properties: dict[str, str], depth: int = 0) -> str:
    """Put values in the place of ${...}; what cannot be evaluated stays."""
    if depth > 20:
        return text

    def one(match: re.Match[str]) -> str:
        inner = match[1].strip()
        if inner in properties:
            return evaluated(properties[inner], properties, depth + 1)
        try:
            value = _value(ast.parse(inner, mode="eval").body, properties, depth)
        except _UNKNOWN:
            return match[0]
        return value if isinstance(value, str) else repr(value)

    text = re.sub(r"\$\(arg (\w+)\)", r"${\1}", text)
    return _EXPRESSION.sub(one, text)


def truth(text: str, properties: dict[str, str]) -> bool | None:
    """Give what a condition says, None if that is not known."""
    said = evaluated(text, properties).strip().lower()
    if said in ("true", "false"):
        return said == "true"
    try:
        return float(said) != 0.0
    except ValueError:
        return None


def _value(node: ast.AST, properties: dict[str, str], depth: int) -> Any:
    """Give the number, text or truth value of an expression."""

    def inner(n: ast.AST) -> Any:
        return _value(n, properties, depth)

    match node:
        case ast.Constant(value=bool() | int() | float() | str()):
            return node.value
        case ast.Name(id="True" | "False"):
            return node.id == "True"
        case ast.Name():
            text = evaluated(properties[node.id], properties, depth + 1)
            if "$" in text:
                raise ValueError(text)
            return _read(text)
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


def _read(text: str) -> Any:
    if text.strip().lower() in ("true", "false"):
        return text.strip().lower() == "true"
    try:
        return float(text)
    except ValueError:
        return text
