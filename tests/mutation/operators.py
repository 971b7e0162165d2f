"""Mutants of Python code, with the operators of cosmic-ray.

Text is not changed, because a user's message has no closed form: strings, f-strings, what an error
or a log entry says. Nor are annotations, decorators, imports and `__all__`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

COMPARED = {"==": ("!=",), "!=": ("==",), "<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="),
            ">=": (">", "<"), "is": ("is not",), "is not": ("is",), "in": ("not in",),
            "not in": ("in",)}  # fmt: skip
ARITHMETIC = {"+": ("-",), "-": ("+",), "*": ("/", "+"), "/": ("*",), "//": ("/",), "%": ("*",),
              "**": ("*",), "<<": (">>",), ">>": ("<<",), "&": ("|",), "|": ("&",), "^": ("&",),
              "@": ("*",)}  # fmt: skip
LOG = re.compile(r"^(log|logger|logging|_log|LOG)\.\w+$")


@dataclass(frozen=True)
class Mutant:
    """A change of one place of a file, in bytes from `start` to `end`."""

    path: str
    line: int
    operator: str
    start: int
    end: int
    old: str
    new: str
    function: str = ""

    def applied(self, source: bytes) -> bytes:
        """Return the changed source."""
        if source[self.start : self.end] != self.old.encode():
            raise ValueError(
                f"{self.path}:{self.line}: expected {self.old!r}; the file has changed since "
                "the mutant was drawn: draw a new sample"
            )
        return source[: self.start] + self.new.encode() + source[self.end :]


class _File:
    def __init__(self, path: str, source: bytes) -> None:
        self.path, self.source = path, source
        self.starts = [0, *(m.end() for m in re.finditer(b"\n", source))]

    def at(self, line: int, column: int) -> int:
        return self.starts[line - 1] + column

    def span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return (
            self.at(node.lineno, node.col_offset),
            self.at(node.end_lineno, node.end_col_offset),
        )

    def change(self, operator: str, start: int, end: int, new: str, function: str) -> Mutant:
        line = self.source.count(b"\n", 0, start) + 1
        old = self.source[start:end].decode()
        return Mutant(self.path, line, operator, start, end, old, new, function)

    def text(self, node: ast.expr | ast.stmt) -> str:
        start, end = self.span(node)
        return self.source[start:end].decode()

    def between(self, left: ast.expr, right: ast.expr, symbol: str) -> tuple[int, int] | None:
        """Return where an operator is; None if a comment stands there as well."""
        start, end = self.span(left)[1], self.span(right)[0]
        found = list(re.finditer(_word(symbol), self.source[start:end].decode()))
        if len(found) != 1 or b"#" in self.source[start:end]:
            return None
        return start + found[0].start(), start + found[0].end()


def _word(symbol: str) -> str:
    if not symbol[0].isalpha():
        return re.escape(symbol)
    return r"\b" + r"\s+".join(symbol.split()) + r"\b"


def python_mutants(path: str, source: bytes) -> list[list[Mutant]]:
    """Return the mutants of each statement that has any, in the file's order."""
    file = _File(path, source)
    found = (list(_of_statement(file, s, f)) for s, f in _statements(ast.parse(source).body, ""))
    return [mutants for mutants in found if mutants]


def _statements(body: list[ast.stmt], function: str) -> Iterator[tuple[ast.stmt, str]]:
    for statement in body:
        if isinstance(statement, ast.Import | ast.ImportFrom | ast.Pass):
            continue
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            continue  # a docstring
        if isinstance(statement, ast.Assign) and "__all__" in ast.unparse(statement.targets[0]):
            continue
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test):
            continue
        if isinstance(statement, ast.Expr) and _logs(statement.value):
            continue
        yield statement, function
        inner = function
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner = f"{function}.{statement.name}".lstrip(".")
        for name in ("body", "orelse", "finalbody"):
            yield from _statements(getattr(statement, name, []), inner)
        for handler in [*getattr(statement, "handlers", []), *getattr(statement, "cases", [])]:
            yield from _statements(handler.body, inner)


def _logs(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and bool(LOG.match(ast.unparse(node.func)))


def _of_statement(file: _File, statement: ast.stmt, function: str) -> Iterator[Mutant]:
    start, end = file.span(statement)

    def whole(operator: str, new: str) -> Mutant:
        return file.change(operator, start, end, new, function)

    match statement:
        case (
            ast.Expr(value=ast.Call() | ast.Await()) | ast.AugAssign() | ast.Raise() | ast.Delete()
        ):
            yield whole("statement removed", "pass")
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield whole("statement removed", "pass")
        case ast.Break():
            yield whole("break to continue", "continue")
        case ast.Continue():
            yield whole("continue to break", "break")
        case ast.Return(value=ast.expr() as value) if ast.unparse(value) != "None":
            yield whole("return None", "return None")
        case ast.For():
            yield file.change("no iteration", *file.span(statement.iter), "()", function)
        case ast.Try():
            for handler in statement.handlers:
                if handler.type is not None:
                    where = file.span(handler.type)
                    yield file.change("exception not caught", *where, "()", function)
    if isinstance(statement, ast.AugAssign):
        symbol = _symbol(statement.op) + "="
        where = file.between(statement.target, statement.value, symbol)
        for other in ARITHMETIC[symbol[:-1]] if where else ():
            yield file.change("arithmetic", *where, other + "=", function)  # type: ignore[misc]
    if isinstance(statement, ast.Raise):
        return  # what an error says is text
    if isinstance(statement, ast.If | ast.While):
        yield file.change(
            "negated", *file.span(statement.test), f"not ({file.text(statement.test)})", function
        )
    for node in _own_expressions(statement):
        yield from _of_expression(file, node, function)


def _own_expressions(statement: ast.stmt) -> Iterator[ast.expr]:
    """Go through the expressions of a statement, not through the statements inside it."""
    for name, value in ast.iter_fields(statement):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        for part in value if isinstance(value, list) else [value]:
            match part:
                case ast.expr():
                    yield part
                case ast.arguments():
                    yield from (d for d in [*part.defaults, *part.kw_defaults] if d is not None)
                case ast.withitem():
                    yield part.context_expr
                case ast.match_case():
                    yield from [part.guard] if part.guard else []
                case ast.keyword():
                    yield part.value


def _of_expression(file: _File, node: ast.expr, function: str) -> Iterator[Mutant]:
    if isinstance(node, ast.JoinedStr) or _logs(node):
        return
    span = file.span(node)

    def change(operator: str, new: str, where: tuple[int, int] | None = span) -> Iterator[Mutant]:
        if where is not None:
            yield file.change(operator, *where, new, function)

    match node:
        case ast.Compare():
            for left, op, right in zip(
                [node.left, *node.comparators], node.ops, node.comparators, strict=False
            ):
                symbol = _symbol(op)
                where = file.between(left, right, symbol)
                for other in COMPARED[symbol]:
                    yield from change("comparison", other, where)
        case ast.BinOp():
            symbol = _symbol(node.op)
            for other in ARITHMETIC[symbol]:
                yield from change("arithmetic", other, file.between(node.left, node.right, symbol))
        case ast.BoolOp():
            old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for left, right in zip(node.values, node.values[1:], strict=False):
                yield from change("boolean", new, file.between(left, right, old))
        case ast.UnaryOp():
            yield from change("operator removed", f"({file.text(node.operand)})")
        case ast.Constant(value=bool() as value):
            yield from change("constant", str(not value))
        case ast.Constant(value=int() | float() as value):
            for other in (value + 1, value - 1):
                if other != value:  # 1e300 + 1 is no other number
                    yield from change("constant", repr(other) if other >= 0 else f"({other!r})")
        case ast.IfExp():
            yield from change("negated", f"not ({file.text(node.test)})", file.span(node.test))
    for child in ast.iter_child_nodes(node):
        for part in child.ifs if isinstance(child, ast.comprehension) else []:
            yield from change("negated", f"not ({file.text(part)})", file.span(part))
        inner = [child.iter, *child.ifs] if isinstance(child, ast.comprehension) else [child]
        for part in inner:
            part = part.value if isinstance(part, ast.keyword) else part
            if isinstance(part, ast.expr):
                yield from _of_expression(file, part, function)


SYMBOLS = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=",
           ast.Is: "is", ast.IsNot: "is not", ast.In: "in", ast.NotIn: "not in", ast.Add: "+",
           ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%",
           ast.Pow: "**", ast.LShift: "<<", ast.RShift: ">>", ast.BitAnd: "&", ast.BitOr: "|",
           ast.BitXor: "^", ast.MatMult: "@"}  # fmt: skip


def _symbol(operator: ast.AST) -> str:
    return SYMBOLS[type(operator)]
