"""Nodes of a metric's tree: signals, arithmetic over time, and reductions to a number.

Every operation is exact, or correctly rounded in one fixed order (sums by `math.fsum`). So a
metric has the same bits whether a kernel or a master simulated its run.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

__all__ = ["Node", "Number", "Operation", "Pointwise", "Reduction", "Signal"]

Array = NDArray[np.float64]
Courses = Mapping[str, Array]  # by variable, of shape (T, size)


@dataclass(frozen=True)
class Node(ABC):
    """Part of a metric: `size` elements, over time if it is a course."""

    size: int
    course: bool
    unit: str | None  # None where units differ, or their combination has no name

    @abstractmethod
    def value(self, time: Array, courses: Courses) -> Array:
        """Return its value, of shape (T, size), or (size,) if it is no course."""

    @property
    def parts(self) -> tuple[Node, ...]:
        """Return what it is made of."""
        return ()

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
    left: Node = Number(1, False, None)
    right: Node = Number(1, False, None)

    @property
    def parts(self) -> tuple[Node, ...]:
        """Return both."""
        return self.left, self.right

    def value(self, time: Array, courses: Courses) -> Array:
        """Return the result."""
        a, b = self.left.value(time, courses), self.right.value(time, courses)
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
    of: Node = Number(1, False, None)

    @property
    def parts(self) -> tuple[Node, ...]:
        """Its argument."""
        return (self.of,)

    def value(self, time: Array, courses: Courses) -> Array:
        """Return the function's value."""
        with np.errstate(all="ignore"):
            return POINTWISE[self.function](self.of.value(time, courses))


def _mean(t: Array, x: Array, q: float) -> float:
    return math.fsum(x.tolist()) / len(x)


def _std(t: Array, x: Array, q: float) -> float:
    middle = _mean(t, x, q)
    return math.sqrt(math.fsum(((x - middle) ** 2).tolist()) / len(x))


def _integral(t: Array, x: Array, q: float) -> float:
    return math.fsum((0.5 * (x[1:] + x[:-1]) * (t[1:] - t[:-1])).tolist())


REDUCTIONS: dict[str, Callable[[Array, Array, float], float]] = {
    "rms": lambda t, x, q: math.sqrt(math.fsum((x * x).tolist()) / len(x)),
    "mean": _mean,
    "std": _std,
    "min": lambda t, x, q: float(np.min(x)),
    "max": lambda t, x, q: float(np.max(x)),
    "first": lambda t, x, q: float(x[0]),
    "final": lambda t, x, q: float(x[-1]),
    "integral": _integral,
    "share": _mean,
    "quantile": lambda t, x, q: float(np.quantile(x, q)),
}


@final
@dataclass(frozen=True)
class Reduction(Node):
    """A course reduced to one number for each element, over the samples of its window."""

    function: str = "mean"
    of: Node = Number(1, False, None)
    q: float = 0.5

    @property
    def parts(self) -> tuple[Node, ...]:
        """Its argument."""
        return (self.of,)

    def value(self, time: Array, courses: Courses) -> Array:
        """Return the numbers."""
        x = np.broadcast_to(self.of.value(time, courses), (len(time), self.of.size))
        columns = (np.ascontiguousarray(x[:, i]) for i in range(self.of.size))
        try:
            return np.array([REDUCTIONS[self.function](time, c, self.q) for c in columns])
        except (OverflowError, ValueError):  # fsum raises them for infinities
            return np.full(self.of.size, np.nan)
