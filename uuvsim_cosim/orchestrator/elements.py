"""What a system holds: elements, connections, groups and exposed connectors, all values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.orchestrator.plan import Algorithm, Solver
from uuvsim_cosim.orchestrator.value_table import Table

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.system import System

__all__ = ["Connection", "Element", "Exposed", "StepGroup", "step_text"]


@dataclass(frozen=True)
class Element:
    """A component or nested system at one name of a system.

    `source` is a source string (see `sources`) or a nested `System`. `start` holds values in
    the unit of their variables. `rate` is the communication step in s; None means every tick.
    `units` holds the units assumed for variables whose description names none.
    """

    name: str
    source: str | System
    start: Mapping[str, Any] = field(default_factory=dict)
    rate: Fraction | None = None
    description: str = ""
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Connection:
    """Value flow between two connectors, written ``element.connector`` or ``…[index]``, from 1.

    The target gets factor · value + offset, after conversion into its unit if `convert`; or, of
    Booleans, integers and enumerations' items, what `table` says.
    """

    source: str
    target: str
    factor: float = 1.0
    offset: float = 0.0
    convert: bool = True
    table: Table = ()


@dataclass(frozen=True)
class StepGroup:
    """Elements stepped together by another rule than the default, in this order.

    `solver`, `tolerance` and `limit` are those of an iterated group (see `plan.Group`).
    """

    members: tuple[str, ...]
    algorithm: Algorithm = "gauss-seidel"
    solver: Solver = "newton"
    tolerance: float = 1e-10
    limit: int = 100


@dataclass(frozen=True)
class Exposed:
    """A connector of the system itself; `path` is the ``element.connector`` inside it."""

    name: str
    path: str


def step_text(step: Fraction) -> str:
    """Write a step as a decimal number if it is one (0.02), else as a ratio (1/60)."""
    rest = step.denominator
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    if rest != 1:
        return f"{step.numerator}/{step.denominator}"
    text = format(float(step), ".12f").rstrip("0").rstrip(".")
    return text if Fraction(text) == step else f"{step.numerator}/{step.denominator}"
