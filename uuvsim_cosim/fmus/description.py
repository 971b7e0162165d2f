"""Description of a component's interface in the terms of FMI 3.0, for every kind of component."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal

from uuvsim_cosim.models.declaration.element_names import element_name, element_names
from uuvsim_cosim.models.declaration.units import Unit

__all__ = [
    "UNITS_ANNOTATION",
    "Causality",
    "ClockTiming",
    "Description",
    "IntervalVariability",
    "Variability",
    "Variable",
    "VariableType",
]

# FMI 3.0 gives an array one unit; where its elements' differ, an annotation of this type in our
# model descriptions lists them, separated by blanks.
UNITS_ANNOTATION = "org.uuvsim.units"

Causality = Literal[
    "parameter", "calculatedParameter", "input", "output", "local", "independent",
    "structuralParameter",
]  # fmt: skip
Variability = Literal["constant", "fixed", "tunable", "discrete", "continuous"]
VariableType = Literal[
    "Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64",
    "UInt64", "Boolean", "String", "Binary", "Enumeration", "Clock",
]  # fmt: skip


IntervalVariability = Literal["constant", "fixed", "tunable", "changing", "countdown", "triggered"]


@dataclass(frozen=True)
class ClockTiming:
    """When a clock of FMI 3.0 ticks: times in s, as exact as the description writes them.

    `interval` is None if the FMU gives it in Initialization Mode. Of clocks that tick at the same
    time, those of the smallest `priority` are activated first.
    """

    variability: IntervalVariability
    interval: Fraction | None = None
    shift: Fraction = Fraction()
    supports_fraction: bool = False
    priority: int = 0

    @property
    def is_periodic(self) -> bool:
        """Return whether all intervals are equal, unless a tunable parameter changes."""
        return self.variability in ("constant", "fixed", "tunable")

    @property
    def is_time_based(self) -> bool:
        """Return whether the importer activates the clock when its time has come."""
        return self.variability != "triggered"


@dataclass(frozen=True)
class Variable:
    """One variable; an FMI 1 or 2 group ``x[1] … x[n]`` is one variable of shape (n,).

    `value_references` holds one reference in FMI 3 (also for an array), and one for each
    element in FMI 1 and 2. `unit` is None if the description names none. `dependencies` (outputs
    only) are names of the inputs that the value depends on directly; None if undeclared.
    """

    name: str
    type: VariableType
    causality: Causality
    variability: Variability
    shape: tuple[int, ...] = ()
    unit: str | None = None
    start: Any = None
    min: float | None = None
    max: float | None = None
    description: str = ""
    initial: str | None = None
    value_references: tuple[int, ...] = ()
    dependencies: tuple[str, ...] | None = None
    element_units: tuple[str | None, ...] = ()  # where the elements' units differ; unit is None
    items: tuple[tuple[str, int], ...] = ()  # of an enumeration: names and numbers
    soft_min: bool = False  # of a declared input, see `Model.input`; XML does not hold it
    negated: bool = False  # FMI 1.0: the value with its opposite sign is at the reference
    clocks: tuple[str, ...] = ()  # of a clocked variable: its value counts while one is active
    timing: ClockTiming | None = None  # of a clock

    @property
    def size(self) -> int:
        """Return the number of scalar elements."""
        n = 1
        for extent in self.shape:
            n *= extent
        return n

    @property
    def element_names(self) -> list[str]:
        """Return the names of its elements, from 1 and row by row; a scalar's is its own."""
        return element_names(self.name, self.shape)

    def element_name(self, i: int) -> str:
        """Return the name of element i, from 0, in the array's flat order: ``x[2]``, ``M[1,2]``."""
        return element_name(self.name, self.shape, i)

    def unit_of_element(self, i: int) -> str | None:
        """Return the unit of element i, from 0, in the array's flat order."""
        return self.element_units[i] if self.element_units else self.unit

    @property
    def units(self) -> tuple[str | None, ...]:
        """Return the unit of every element, in the array's flat order."""
        return self.element_units or (self.unit,) * self.size

    @property
    def unit_text(self) -> str:
        """Return the unit for a reader: ``m, rad`` where the elements' units differ."""
        return ", ".join(dict.fromkeys(u or "?" for u in self.element_units)) or self.unit or ""


@dataclass(frozen=True)
class Description:
    """A component's interface: variables by name, capabilities, and where it came from."""

    name: str
    kind: Literal["FMI 1.0", "FMI 2.0", "FMI 3.0", "native", "python"]
    variables: Mapping[str, Variable]
    token: str = ""
    description: str = ""
    generation_tool: str = ""
    units: Mapping[str, Unit] = field(default_factory=dict)
    default_step_size: float | None = None
    can_get_and_set_state: bool = False
    can_serialize_state: bool = False
    can_be_instantiated_only_once: bool = False
    can_handle_variable_step: bool = True  # FMI's canHandleVariableCommunicationStepSize
    has_event_mode: bool = False  # an FMU of FMI 3.0 for Co-Simulation
    provides_directional_derivatives: bool = False
    needs_execution_tool: bool = False
    made_for: Mapping[str, str] = field(default_factory=dict)  # see fmus/pairs.py
    peers: Mapping[str, str] = field(default_factory=dict)  # see orchestrator/system/system.py

    @property
    def clocks(self) -> list[Variable]:
        """List its clocks (FMI 3.0), in the order of their priority."""
        found = [v for v in self.variables.values() if v.timing is not None]
        return sorted(found, key=lambda v: v.timing.priority if v.timing else 0)

    def of(self, *causalities: Causality) -> list[Variable]:
        """List the variables of the given causalities, in the order of the description."""
        return [v for v in self.variables.values() if v.causality in causalities]
