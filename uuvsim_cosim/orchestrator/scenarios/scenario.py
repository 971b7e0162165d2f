"""Scenarios: changes and faults of a system at given times of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from uuvsim_cosim.orchestrator.master.faults import Fault

__all__ = ["Change", "Event", "Manipulation", "Scenario", "SignalFault"]


@dataclass(frozen=True)
class Change:
    """At time `at` [s] a tunable parameter or an unconnected input gets a value, in its unit."""

    at: float
    variable: str
    value: Any


@dataclass(frozen=True)
class SignalFault:
    """From `at` to `until` [s] a signal is faulty: at the communication points in [at, until)."""

    at: float
    fault: Fault
    until: float = math.inf


@dataclass(frozen=True)
class Manipulation:
    """From `at` to `until` [s] a variable of whatever causality is overridden, or biased.

    What that means follows from the system (see `manipulation`): a fault of an output, a change
    of a parameter or an unconnected input, a fault of the output that feeds a connected input.
    """

    at: float
    variable: str
    kind: Literal["override", "bias"]
    value: float
    until: float = math.inf


Event = Change | SignalFault | Manipulation


@dataclass(frozen=True)
class Scenario:
    """Events in any order; those of one instant happen in the order of the list.

    `end` [s] is that of a run which is given none.
    """

    name: str
    events: tuple[Event, ...]
    description: str = ""
    end: float | None = None
