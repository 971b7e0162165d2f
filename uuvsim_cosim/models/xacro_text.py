"""An XML description of a robot, with what xacro's properties and includes say put in place.

Not a whole xacro: properties, arithmetic, includes found beside the file, and the bodies of macros
as they stand. What stays unknown (`${namespace}`) stays as it is; who needs a number there refuses.
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

__all__ = ["evaluated", "local", "read_description"]

_EXPRESSION = re.compile(r"\$\{([^{}]*)\}")
_OPERATIONS: dict[type, Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_FUNCTIONS: dict[str, Callable[..., float]] = {
    **{n: getattr(math, n) for n in ("sin", "cos", "tan", "sqrt", "radians", "degrees", "atan2")},
    "abs": abs,
    "min": min,
    "max": max,
}
_MOST_FILES = 50


def local(element: Any) -> str:
    """Give an element's name without its namespace; empty for a comment."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def read_description(path: Path) -> Any:
    """Read a file and what it includes into one tree, texts resolved; raises InputInvalid."""
    seen: list[Path] = []
    root = _parsed(path)
    _include(root, path, seen)
    properties: dict[str, str] = {"pi": repr(math.pi)}
    for element in root.iter():
        if _is_xacro(element, "property") and element.get("name") is not None:
            properties.setdefault(element.get("name"), element.get("value") or "")
        elif _is_xacro(element, "arg") and element.get("default") is not None:
            properties.setdefault(element.get("name"), element.get("default"))
    for element in root.iter():
        if not isinstance(element.tag, str):
            continue
        for key, value in element.attrib.items():
            if "$" in value:
                element.set(key, evaluated(value, properties))
        if element.text and "$" in element.text:
            element.text = evaluated(element.text, properties)
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


def _is_xacro(element: Any, name: str) -> bool:
    return isinstance(element.tag, str) and "xacro" in element.tag and local(element) == name


def _include(root: Any, path: Path, seen: list[Path]) -> None:
    """Put the children of each included file that lies near in the place of its include."""
    seen.append(path.resolve())
    for element in list(root.iter()):
        if not _is_xacro(element, "include"):
            continue
        found = next(_near(element.get("filename") or "", path), None)
        if found is None or found.resolve() in seen or len(seen) >= _MOST_FILES:
            continue
        inner = _parsed(found)
        _include(inner, found, seen)
        parent = element.getparent()
        at = parent.index(element)
        for k, child in enumerate(list(inner)):
            parent.insert(at + 1 + k, child)


def _near(name: str, path: Path) -> Iterator[Path]:
    """Give the files that an include may mean: `$(find package)/urdf/a.xacro` by its last parts."""
    plain = re.sub(r"\$\([^)]*\)", "", name).lstrip("/")
    if not plain or "$" in plain:
        return
    for base in (path.parent, *list(path.parent.parents)[:2]):
        for candidate in (base / plain, base / Path(plain).name):
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
            return repr(_number(ast.parse(inner, mode="eval").body, properties, depth))
        except (SyntaxError, ValueError, KeyError, ZeroDivisionError, TypeError, OverflowError):
            return match[0]

    text = re.sub(r"\$\(arg (\w+)\)", r"${\1}", text)
    return _EXPRESSION.sub(one, text)


def _number(node: ast.AST, properties: dict[str, str], depth: int) -> float:
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return float(node.value)
    if isinstance(node, ast.Name):
        return float(evaluated(properties[node.id], properties, depth + 1))
    if isinstance(node, ast.BinOp):
        left, right = (_number(n, properties, depth) for n in (node.left, node.right))
        return _OPERATIONS[type(node.op)](left, right)
    if isinstance(node, ast.UnaryOp):
        return _OPERATIONS[type(node.op)](_number(node.operand, properties, depth))
    if isinstance(node, ast.Call):
        name = (
            node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        )
        return _FUNCTIONS[name](*(_number(a, properties, depth) for a in node.args))
    if isinstance(node, ast.Attribute) and node.attr == "pi":
        return math.pi
    raise ValueError(ast.dump(node))
