"""Parts of a system: elements, connections, groups and exposed connectors, all values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Literal

from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.orchestrator.system.variable_step import VariableStep
from uuvsim_cosim.orchestrator.values.transformation import Table

__all__ = [
    "Algorithm",
    "Connection",
    "Element",
    "Exposed",
    "Loops",
    "Solver",
    "StepGroup",
    "Structure",
    "step_text",
]

Algorithm = Literal["jacobi", "gauss-seidel", "iterated"]
Solver = Literal["newton", "anderson", "fixed-point"]
Loops = Literal["iterate", "refuse", "delay"]  # policy for algebraic loops
Mismatches = Literal["refuse", "warn"]  # policy for parts that are made for another vehicle


@dataclass(frozen=True)
class Element:
    """A component or nested system at one name of a system.

    `source` is a source string (see `resolve`) or a nested system. `start` holds values in
    the unit of their variables. `rate` is the communication step in s; None means every tick.
    `units` holds the units assumed for variables whose description names none.
    """

    name: str
    source: str | Structure
    start: Mapping[str, object] = field(default_factory=dict)
    rate: Fraction | None = None
    description: str = ""
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Connection:
    """Value flow between two connectors, written ``element.connector`` or ``…[index]``, from 1.

    The target gets factor · value + offset, after conversion into its unit if `convert`. With a
    `table` (Booleans, integers, items of enumerations) it gets the table's entry instead.
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


@dataclass(frozen=True)
class Structure(ABC):
    """The fields of a system; `System` checks and edits them.

    `tick` is the base step in s, exact; a run goes from `start_time` to `stop_time` [s] by
    default. `loops` is the policy for algebraic loops (see `System.with_loops`); that of a nested
    system is not used, nor is its policy for `mismatches` (see `System.with_mismatches`), nor its
    `variable_step` (see `System.with_variable_step`), nor its `events` (see `System.with_events`).
    Relative files of sources are in `base`.
    """

    name: str
    tick: Fraction | str | float = "0.01"
    description: str = ""
    elements: tuple[Element, ...] = ()
    connections: tuple[Connection, ...] = ()
    groups: tuple[StepGroup, ...] = ()
    exposed: tuple[Exposed, ...] = ()
    base: Path | None = field(default=None, compare=False)
    remarks: tuple[str, ...] = field(default=(), compare=False)
    stop_time: float | None = None
    loops: Loops = "iterate"
    start_time: float = 0.0
    mismatches: Mismatches = "refuse"
    variable_step: VariableStep | None = None
    events: bool = False

    @property
    def base_step(self) -> Fraction:
        """The tick [s]."""
        return Fraction(self.tick)

    @property
    def components(self) -> dict[str, Element]:
        """The elements by name."""
        return {e.name: e for e in self.elements}

    @abstractmethod
    def interface(self) -> Description:
        """Describe the system as a component: its exposed connectors."""


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
