"""Text in xacro: properties, arithmetic and conditions put in the place of `${...}`.

An expression that cannot be evaluated (`${namespace}`) stays as it is. The reader of a number
refuses it.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lxml.etree import _Element
__all__ = ["INCLUDED_FROM", "evaluated", "is_included", "is_xacro", "local", "truth"]

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
INCLUDED_FROM = "{urn:uuvsim}file"  # of an element that was included


def local(element: _Element) -> str:
    """Return an element's name without its namespace; empty for a comment."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def is_included(element: _Element) -> bool:
    """Return whether an element stands in a file that was included."""
    return element.get(INCLUDED_FROM) is not None


def is_xacro(element: _Element, name: str) -> bool:
    """Return whether an element is xacro's of that name."""
    return isinstance(element.tag, str) and "xacro" in element.tag and local(element) == name


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
    """Return what a condition says, None if that is not known."""
    value = evaluated(text, properties).strip().lower()
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
