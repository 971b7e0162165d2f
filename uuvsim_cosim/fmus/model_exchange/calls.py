"""FMI calls of Model Exchange, with their names in FMI 1.0, 2.0 and 3.0."""

from __future__ import annotations

import ctypes
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, final

from uuvsim_cosim.fmus.importer.fmu1 import EventInfo, Fmu1
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.versions import AnyFmu

__all__ = ["Calls", "Event", "calls_of"]


@dataclass(frozen=True)
class Event:
    """The result of one round of event iteration."""

    again: bool
    ends: bool
    next_time: float


class Calls(ABC):
    """The calls of one instance; arrays are passed as pointers to double, with their size."""

    states: int
    indicators: int
    derivatives: ClassVar[str] = "GetDerivatives"
    nominals: ClassVar[str] = "GetNominalsOfContinuousStates"
    boolean: ClassVar[type[ctypes.c_int | ctypes.c_bool]] = ctypes.c_int

    def __init__(self, fmu: AnyFmu) -> None:
        self.fmu = fmu
        self.set_time = partial(fmu.call, "SetTime")
        self.get_states = partial(fmu.call, "GetContinuousStates")
        self.set_states = partial(fmu.call, "SetContinuousStates")
        self.get_derivatives = partial(fmu.call, self.derivatives)
        self.get_nominals = partial(fmu.call, self.nominals)
        self.states = fmu.archive.n_states
        self.indicators = fmu.archive.n_event_indicators

    def enter_continuous_time_mode(self) -> None:
        """Enter Continuous-Time Mode."""
        self.fmu.call("EnterContinuousTimeMode")

    def enter_event_mode(self) -> None:
        """Enter Event Mode."""
        self.fmu.call("EnterEventMode")

    def get_indicators(self, pointer: object, n: int) -> None:
        """Read the event indicators."""
        if n:
            self.fmu.call("GetEventIndicators", pointer, n)

    def completed_integrator_step(self) -> tuple[bool, bool]:
        """Return whether the FMU wants an event, and whether it ends the simulation."""
        event, end = self.boolean(), self.boolean()
        last = self.fmu.never_goes_back
        self.fmu.call("CompletedIntegratorStep", last, ctypes.byref(event), ctypes.byref(end))
        return bool(event.value), bool(end.value)

    @abstractmethod
    def update_discrete_states(self) -> Event:
        """Make one round of event iteration."""


@final
class Calls1(Calls):
    """FMI 1.0, which has no modes: an event is a call of fmiEventUpdate."""

    nominals = "GetNominalContinuousStates"

    def __init__(self, fmu: Fmu1) -> None:
        super().__init__(fmu)
        self._first = fmu.first_event  # the result of the event iteration in fmiInitialize

    def enter_continuous_time_mode(self) -> None:
        """Do nothing."""

    def enter_event_mode(self) -> None:
        """Do nothing."""

    def completed_integrator_step(self) -> tuple[bool, bool]:
        """Return whether the FMU wants an event; it cannot end the simulation here."""
        event = ctypes.c_int8()
        self.fmu.call("CompletedIntegratorStep", ctypes.byref(event))
        return bool(event.value), False

    def update_discrete_states(self) -> Event:
        """Make one round of event iteration; the first one was made by fmiInitialize."""
        info, self._first = self._first, None
        if info is None:
            info = EventInfo()
            self.fmu.call("EventUpdate", 0, ctypes.byref(info))
        next_time = info.next_time if info.next_defined else math.inf
        return Event(not info.converged, bool(info.terminate), next_time)


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
    boolean = ctypes.c_bool

    def __init__(self, fmu: Fmu3) -> None:
        super().__init__(fmu)
        count = ctypes.c_size_t()
        fmu.call("GetNumberOfContinuousStates", ctypes.byref(count))
        self.states = count.value
        fmu.call("GetNumberOfEventIndicators", ctypes.byref(count))
        self.indicators = count.value

    def update_discrete_states(self) -> Event:
        """Make one round of event iteration."""
        again, end, nominals, values, defined = (ctypes.c_bool() for _ in range(5))
        next_time = ctypes.c_double()
        flags = (again, end, nominals, values, defined)
        self.fmu.call("UpdateDiscreteStates", *map(ctypes.byref, flags), ctypes.byref(next_time))
        return Event(again.value, end.value, next_time.value if defined.value else math.inf)


def calls_of(fmu: AnyFmu) -> Calls:
    """Return the calls of an instance, which has left Initialization Mode."""
    if isinstance(fmu, Fmu1):
        return Calls1(fmu)
    return Calls2(fmu) if isinstance(fmu, Fmu2) else Calls3(fmu)
