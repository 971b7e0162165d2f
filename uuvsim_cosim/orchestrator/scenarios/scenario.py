"""Scenarios: changes and faults of a system at given times of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from uuvsim_cosim.orchestrator.master.faults import Fault

__all__ = ["Change", "Event", "Manipulation", "Scenario", "SignalFault"]


@dataclass(frozen=True)
class Change:
    """At time `at` [s] a tunable parameter or an unconnected input gets a value, in its unit."""

    at: float
    variable: str
    value: object


@dataclass(frozen=True)
class SignalFault:
    """From `at` to `until` [s] a signal is faulty: at the communication points in [at, until)."""

    at: float
    fault: Fault
    until: float = math.inf


@dataclass(frozen=True)
class Manipulation:
    """From `at` to `until` [s] a variable of any causality is overridden, or biased.

    Its meaning depends on the system (see `manipulation`): a fault of an output, a change of a
    parameter or an unconnected input, a fault of the output that feeds a connected input.
    """

    at: float
    variable: str
    kind: Literal["override", "bias"]
    value: float
    until: float = math.inf


Event = Change | SignalFault | Manipulation


@dataclass(frozen=True)
class Scenario:
    """Events in any order; events of the same time are applied in the order of the list.

    `end` [s] is the end of a run if the run itself has none.
    """

    name: str
    events: tuple[Event, ...]
    description: str = ""
    end: float | None = None
