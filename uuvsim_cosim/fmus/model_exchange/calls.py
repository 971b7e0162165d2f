"""FMI calls of Model Exchange, with their names in FMI 2.0 and FMI 3.0."""

from __future__ import annotations

import ctypes
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, final

from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3

__all__ = ["Calls", "Calls2", "Calls3", "Event"]


@dataclass(frozen=True)
class Event:
    """The result of one round of event iteration."""

    again: bool
    ends: bool
    next_time: float


class Calls(ABC):
    """The calls of one instance; arrays are passed as pointers to double, with their size."""

    fmu: Fmu2 | Fmu3
    states: int
    indicators: int
    derivatives: ClassVar[str]
    nominals: ClassVar[str]

    def set_time(self, time: float) -> None:
        """Set the independent variable [s]."""
        self.fmu.call("SetTime", time)

    def get_states(self, pointer: object, n: int) -> None:
        """Read the continuous states."""
        self.fmu.call("GetContinuousStates", pointer, n)

    def set_states(self, pointer: object, n: int) -> None:
        """Set the continuous states."""
        self.fmu.call("SetContinuousStates", pointer, n)

    def get_derivatives(self, pointer: object, n: int) -> None:
        """Read the states' derivatives."""
        self.fmu.call(self.derivatives, pointer, n)

    def get_indicators(self, pointer: object, n: int) -> None:
        """Read the event indicators."""
        if n:
            self.fmu.call("GetEventIndicators", pointer, n)

    def get_nominals(self, pointer: object, n: int) -> None:
        """Read the states' nominal values."""
        self.fmu.call(self.nominals, pointer, n)

    def enter_continuous_time_mode(self) -> None:
        """Leave Event Mode."""
        self.fmu.call("EnterContinuousTimeMode")

    def enter_event_mode(self) -> None:
        """Leave Continuous-Time Mode."""
        self.fmu.call("EnterEventMode")

    @abstractmethod
    def completed_integrator_step(self) -> tuple[bool, bool]:
        """Return whether the FMU wants an event, and whether it ends the simulation."""

    @abstractmethod
    def update_discrete_states(self) -> Event:
        """Make one round of event iteration."""


class _EventInfo(ctypes.Structure):
    """``fmi2EventInfo``."""

    _fields_ = (
        ("needed", ctypes.c_int),
        ("terminate", ctypes.c_int),
        ("nominals_changed", ctypes.c_int),
        ("values_changed", ctypes.c_int),
        ("next_defined", ctypes.c_int),
        ("next_time", ctypes.c_double),
    )


@final
class Calls2(Calls):
    """FMI 2.0."""

    derivatives = "GetDerivatives"
    nominals = "GetNominalsOfContinuousStates"

    def __init__(self, fmu: Fmu2) -> None:
        self.fmu = fmu
        self.states = fmu.archive.n_states
        self.indicators = fmu.archive.n_event_indicators

    def completed_integrator_step(self) -> tuple[bool, bool]:
        """Return whether the FMU wants an event, and whether it ends the simulation."""
        event, end = ctypes.c_int(), ctypes.c_int()
        last = int(self.fmu.never_goes_back)
        self.fmu.call("CompletedIntegratorStep", last, ctypes.byref(event), ctypes.byref(end))
        return bool(event.value), bool(end.value)

    def update_discrete_states(self) -> Event:
        """Make one round of event iteration."""
        info = _EventInfo()
        self.fmu.call("NewDiscreteStates", ctypes.byref(info))
        next_time = info.next_time if info.next_defined else math.inf
        return Event(bool(info.needed), bool(info.terminate), next_time)


@final
class Calls3(Calls):
    """FMI 3.0."""

    derivatives = "GetContinuousStateDerivatives"
    nominals = "GetNominalsOfContinuousStates"

    def __init__(self, fmu: Fmu3) -> None:
        self.fmu = fmu
        self.states = self._count("GetNumberOfContinuousStates")
        self.indicators = self._count("GetNumberOfEventIndicators")

    def completed_integrator_step(self) -> tuple[bool, bool]:
        """Return whether the FMU wants an event, and whether it ends the simulation."""
        event, end = ctypes.c_bool(), ctypes.c_bool()
        last = self.fmu.never_goes_back
        self.fmu.call("CompletedIntegratorStep", last, ctypes.byref(event), ctypes.byref(end))
        return event.value, end.value

    def update_discrete_states(self) -> Event:
        """Make one round of event iteration."""
        again, end, nominals, values, defined = (ctypes.c_bool() for _ in range(5))
        next_time = ctypes.c_double()
        flags = (again, end, nominals, values, defined)
        self.fmu.call("UpdateDiscreteStates", *map(ctypes.byref, flags), ctypes.byref(next_time))
        return Event(again.value, end.value, next_time.value if defined.value else math.inf)

    def _count(self, function: str) -> int:
        n = ctypes.c_size_t()
        self.fmu.call(function, ctypes.byref(n))
        return n.value
