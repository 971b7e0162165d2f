"""Metrics as text: ``rms(wrap(hull.eta[6] - navigation.eta[6]))`` is parsed into a tree.

Every operation is exact, or correctly rounded in one fixed order (sums by `math.fsum`). So a
metric has the same bits whether a kernel or a master simulated its run.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.values.endpoints import resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = [
    "Metric",
    "Node",
    "Number",
    "Operation",
    "Pointwise",
    "ReadMetric",
    "Reduction",
    "Signal",
    "read_metric",
]

Array = NDArray[np.float64]
Courses = Mapping[str, Array]  # by variable, of shape (T, size)


@dataclass(frozen=True)
class Node(ABC):
    """Part of a metric: `size` elements, over time if it is a course."""

    size: int
    course: bool
    unit: str | None  # None where units differ, or their combination has no name
    parts: tuple[Node, ...] = ()  # that it is made of

    @abstractmethod
    def value(self, time: Array, courses: Courses) -> Array:
        """Return its value, of shape (T, size), or (size,) if it is no course."""

    def signals(self) -> Iterator[str]:
        """Return the variables that it reads."""
        for part in self.parts:
            yield from part.signals()


@final
@dataclass(frozen=True)
class Number(Node):
    """A number that is written out."""

    number: float = 0.0

    def value(self, time: Array, courses: Courses) -> Array:
        """Return the number."""
        return np.array([self.number])


@final
@dataclass(frozen=True)
class Signal(Node):
    """Elements of a variable."""

    name: str = ""
    elements: tuple[int, ...] = ()

    def value(self, time: Array, courses: Courses) -> Array:
        """Return its course."""
        return courses[self.name][:, list(self.elements)]

    def signals(self) -> Iterator[str]:
        """Return its name."""
        yield self.name


OPERATIONS: dict[str, Callable[[Array, Array], Array]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "<": lambda a, b: np.less(a, b).astype(float),
    ">": lambda a, b: np.greater(a, b).astype(float),
}


@final
@dataclass(frozen=True)
class Operation(Node):
    """Arithmetic or a comparison of two parts, element by element; a comparison gives 1 or 0."""

    sign: str = "+"

    def value(self, time: Array, courses: Courses) -> Array:
        """Return the result."""
        a, b = (part.value(time, courses) for part in self.parts)
        with np.errstate(all="ignore"):
            return np.asarray(OPERATIONS[self.sign](a, b))


def _norm(x: Array) -> Array:
    total = x[..., :1] * x[..., :1]
    for i in range(1, x.shape[-1]):
        total = total + x[..., i : i + 1] * x[..., i : i + 1]
    return np.asarray(np.sqrt(total))


POINTWISE: dict[str, Callable[[Array], Array]] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "norm": _norm,
    "wrap": lambda x: (x + np.pi) % (2.0 * np.pi) - np.pi,
}


@final
@dataclass(frozen=True)
class Pointwise(Node):
    """A function of each instant: abs, sqrt, norm (over elements), wrap (an angle to ±pi)."""

    function: str = "abs"

    def value(self, time: Array, courses: Courses) -> Array:
        """Return the function's value."""
        with np.errstate(all="ignore"):
            return POINTWISE[self.function](self.parts[0].value(time, courses))


def _mean(t: Array, x: Array, q: float) -> float:
    return math.fsum(x.tolist()) / len(x)


REDUCTIONS: dict[str, Callable[[Array, Array, float], float]] = {
    "rms": lambda t, x, q: math.sqrt(math.fsum((x * x).tolist()) / len(x)),
    "mean": _mean,
    "std": lambda t, x, q: math.sqrt(math.fsum(((x - _mean(t, x, q)) ** 2).tolist()) / len(x)),
    "min": lambda t, x, q: float(np.min(x)),
    "max": lambda t, x, q: float(np.max(x)),
    "first": lambda t, x, q: float(x[0]),
    "final": lambda t, x, q: float(x[-1]),
    "integral": lambda t, x, q: math.fsum((0.5 * (x[1:] + x[:-1]) * (t[1:] - t[:-1])).tolist()),
    "share": _mean,
    "quantile": lambda t, x, q: float(np.quantile(x, q)),
}


@final
@dataclass(frozen=True)
class Reduction(Node):
    """A course reduced to one number for each element, over the samples of its window."""

    function: str = "mean"
    q: float = 0.5

    def value(self, time: Array, courses: Courses) -> Array:
        """Return the numbers."""
        x = np.broadcast_to(self.parts[0].value(time, courses), (len(time), self.size))
        columns = (np.ascontiguousarray(x[:, i]) for i in range(self.size))
        try:
            return np.array([REDUCTIONS[self.function](time, c, self.q) for c in columns])
        except (OverflowError, ValueError):  # fsum raises them for infinities
            return np.full(self.size, np.nan)


_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*(?:\[[^\[\]]*\])?)|(?P<sign>[-+*/()<>,]))"
)
_LEVELS = (("<", ">"), ("+", "-"), ("*", "/"))  # operators, the weakest first
FUNCTIONS = (*POINTWISE, *REDUCTIONS)


@dataclass(frozen=True)
class Metric:
    """Metric of a run: an expression over the samples from `after` to `until` [s]."""

    expression: str
    after: Fraction = Fraction(0)
    until: Fraction | None = None


@final
@dataclass(frozen=True)
class ReadMetric:
    """Metric whose names have been resolved in a system."""

    name: str
    metric: Metric
    root: Node

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of its numbers: its own name, with the element if there are several."""
        n = self.root.size
        return tuple(element_names(self.name, (n,) if n > 1 else ()))

    def value(self, time: NDArray[np.float64], courses: Courses) -> list[float]:
        """Return its numbers from the courses of one run; NaN if no sample is in its window."""
        end = time[-1] if self.metric.until is None else float(self.metric.until)
        inside = (time >= float(self.metric.after)) & (time <= end)
        if not inside.any():
            return [np.nan] * self.root.size
        cut = {k: v[inside] for k, v in courses.items()}
        return [float(x) for x in self.root.value(time[inside], cut)]


def read_metric(name: str, metric: Metric, descriptions: Mapping[str, Description]) -> ReadMetric:
    """Read an expression; raises InputInvalid with the place in it and what was expected."""
    parser = _Parser(metric.expression, descriptions)
    root = parser.whole()
    if root.course:
        raise InputInvalid(
            f"{metric.expression!r} is a course over time",
            f"a number of it, such as rms({metric.expression})",
        )
    return ReadMetric(name, metric, root)


class _Parser:
    """Recursive descent: comparison, sum, product, sign, atom; comparisons bind weakest."""

    def __init__(self, text: str, descriptions: Mapping[str, Description]) -> None:
        self.text = text
        self.descriptions = descriptions
        self.tokens: list[tuple[str, str, int]] = []
        at = 0
        while text[at:].strip():
            match = _TOKEN.match(text, at)
            if match is None:
                rest = text[at:].lstrip()
                raise self._wrong(f"{rest[:12]!r}", "a name, a number, ( ) + - * / < >",
                                  len(text) - len(rest))  # fmt: skip
            kind = str(match.lastgroup)
            self.tokens.append((kind, match[kind], match.start(kind)))
            at = match.end()
        self.at = 0

    def whole(self) -> Node:
        node = self._expression()
        if self._peek():
            raise self._wrong(f"{self._peek()!r}", "an operator, or the end")
        return node

    def _expression(self, level: int = 0) -> Node:
        """Parse operations of this and the stronger levels; comparisons are not chained."""
        if level == len(_LEVELS):
            return self._signed()
        node = self._expression(level + 1)
        while self._peek() in _LEVELS[level]:
            node = self._both(self._next(), node, self._expression(level + 1))
            if level == 0:
                break
        return node

    def _signed(self) -> Node:
        if self._peek() == "-":
            self._next()
            return self._both("*", Number(1, False, "1", number=-1.0), self._signed())
        return self._atom()

    def _atom(self) -> Node:
        if self.at == len(self.tokens):
            raise self._wrong("the end", "a name, a number, a function or (")
        kind, token, _ = self.tokens[self.at]
        if kind == "number":
            self._next()
            return Number(1, False, "1", number=float(token))
        if token == "(":
            self._next()
            node = self._expression()
            self._must(")")
            return node
        if kind != "name":
            raise self._wrong(f"{token!r}", "a name, a number, a function or (")
        following = self.tokens[self.at + 1][1] if self.at + 1 < len(self.tokens) else ""
        return self._call(token) if following == "(" else self._signal(token)

    def _call(self, name: str) -> Node:
        if name not in FUNCTIONS:
            raise self._wrong(f"function {name!r}", expected_names(name, FUNCTIONS))
        begin = self.at
        self._next()
        self._must("(")
        of = self._expression()
        q = 0.5
        if name == "quantile":
            self._must(",")
            number = self._signed()
            q = float(number.value(np.zeros(1), {})[0]) if not number.course else -1.0
            if not 0.0 <= q <= 1.0:
                raise self._wrong("the second argument of quantile", "a number in [0, 1]", begin)
        self._must(")")
        if name in POINTWISE:
            unit = of.unit if name != "sqrt" else None
            return Pointwise(1 if name == "norm" else of.size, of.course, unit, (of,), name)
        if not of.course:
            raise self._wrong(f"{name} of a number", "a signal over time", begin)
        unit = None if name == "integral" else of.unit
        return Reduction(of.size, False, "1" if name == "share" else unit, (of,), name, q)

    def _signal(self, text: str) -> Node:
        try:
            point = resolve_endpoint(text, self.descriptions)
        except Misfit as misfit:
            near = "" if "." in text else f", or a function: {', '.join(FUNCTIONS)}"
            raise self._wrong(misfit.read, misfit.expected + near) from None
        v = point.variable
        if v.type in ("String", "Binary", "Clock"):
            raise self._wrong(f"{text} is a {v.type}", "a number")
        units = {v.unit_of_element(i) for i in point.elements}
        self._next()
        unit = (units.pop() or "1") if len(units) == 1 else None
        name = f"{point.element}.{v.name}"
        return Signal(len(point.elements), True, unit, (), name, point.elements)

    def _both(self, sign: str, a: Node, b: Node) -> Node:
        if 1 not in (a.size, b.size) and a.size != b.size:
            raise self._wrong(f"{a.size} {sign} {b.size} elements", "equally many, or one of them")
        unit: str | None = "1"
        if sign in "+-":
            unit = a.unit if a.unit == b.unit else None
        elif sign in "*/":
            unit = a.unit if b.unit == "1" else b.unit if (a.unit, sign) == ("1", "*") else None
            unit = "1" if sign == "/" and a.unit == b.unit is not None else unit
        return Operation(max(a.size, b.size), a.course or b.course, unit, (a, b), sign)

    def _peek(self) -> str:
        return self.tokens[self.at][1] if self.at < len(self.tokens) else ""

    def _next(self) -> str:
        self.at += 1
        return self.tokens[self.at - 1][1]

    def _must(self, sign: str) -> None:
        if self._peek() != sign:
            raise self._wrong(repr(self._peek()) if self._peek() else "the end", repr(sign))
        self._next()

    def _wrong(self, read: str, expected: str, at: int | None = None) -> InputInvalid:
        tokens = getattr(self, "tokens", [])
        i = getattr(self, "at", 0)
        place = at if at is not None else tokens[i][2] if i < len(tokens) else len(self.text)
        return InputInvalid(f"{self.text!r}, character {place + 1}", read, expected)
