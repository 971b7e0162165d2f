"""An instance of an FMI 3.0 FMU in this process."""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import ClassVar, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.codegen.toolchain import Signatures
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.importer.fmu_access import Access, BinaryAccess, NumericAccess, StringAccess
from uuvsim_cosim.fmus.importer.fmu_binary import COMMON, FmuBinary, FmuState, Phase

__all__ = ["ClockStart", "Fmu3"]

_P, _I, _D, _Z, _S, _B = (
    ctypes.c_void_p,
    ctypes.c_int,
    ctypes.c_double,
    ctypes.c_size_t,
    ctypes.c_char_p,
    ctypes.c_bool,
)
_TYPES = (
    "Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64",
    "UInt64", "Boolean", "String",
)  # fmt: skip
_ROUNDS = 100  # of an event iteration
_UNKNOWN, _CHANGED = 0, 2  # of fmi3IntervalQualifier
_IN_EVENT_MODE = 0x80  # in the first byte of a serialised state
_VALUES = (_I, (_P, _P, _Z, _P, _Z))


@dataclass(frozen=True)
class ClockStart:
    """How a time-based clock begins: its interval [s], if it is known, and its first tick [s]."""

    is_periodic: bool
    interval: Fraction | None
    shift: Fraction


@final
class Fmu3(FmuBinary):
    """The `Component` protocol over FMI 3.0's functions.

    With `FmuArchive.events`, it uses Event Mode and may return early; the stepping loop in C
    handles its events.
    """

    prefix = "fmi3"
    kind = BindingKind.FMI3
    state_word = "FMUState"
    deserialize = "DeserializeFMUState"
    counts_values = True
    signatures: ClassVar[Signatures] = {
        **COMMON,
        "InstantiateCoSimulation": (_P, (_S, _S, _S, _B, _B, _B, _B, _P, _Z, _P, _P, _P)),
        "InstantiateModelExchange": (_P, (_S, _S, _S, _B, _B, _P, _P)),
        "EnterInitializationMode": (_I, (_P, _B, _D, _D, _B, _D)),
        "EnterStepMode": (_I, (_P,)),
        "EnterConfigurationMode": (_I, (_P,)),
        "ExitConfigurationMode": (_I, (_P,)),
        **{f"Get{t}": _VALUES for t in _TYPES},
        **{f"Set{t}": _VALUES for t in _TYPES},
        "GetBinary": (_I, (_P, _P, _Z, _P, _P, _Z)),
        "SetBinary": (_I, (_P, _P, _Z, _P, _P, _Z)),
        "GetClock": (_I, (_P, _P, _Z, _P)),
        "SetClock": (_I, (_P, _P, _Z, _P)),
        "GetIntervalDecimal": (_I, (_P, _P, _Z, _P, _P)),
        "GetIntervalFraction": (_I, (_P, _P, _Z, _P, _P, _P)),
        "GetShiftDecimal": (_I, (_P, _P, _Z, _P)),
        "GetShiftFraction": (_I, (_P, _P, _Z, _P, _P)),
        "SetIntervalDecimal": (_I, (_P, _P, _Z, _P)),
        "GetFMUState": (_I, (_P, _P)),
        "SetFMUState": (_I, (_P, _P)),
        "FreeFMUState": (_I, (_P, _P)),
        "SerializedFMUStateSize": (_I, (_P, _P, _P)),
        "SerializeFMUState": (_I, (_P, _P, _P, _Z)),
        "DeserializeFMUState": (_I, (_P, _P, _Z, _P)),
        "GetDirectionalDerivative": (_I, (_P, _P, _Z, _P, _Z, _P, _Z, _P, _Z)),
        "DoStep": (_I, (_P, _D, _D, _B, _P, _P, _P, _P)),
        "GetNumberOfContinuousStates": (_I, (_P, _P)),
        "GetNumberOfEventIndicators": (_I, (_P, _P)),
        "GetContinuousStateDerivatives": (_I, (_P, _P, _Z)),
        "UpdateDiscreteStates": (_I, (_P, _P, _P, _P, _P, _P, _P)),
        "CompletedIntegratorStep": (_I, (_P, _B, _P, _P)),
    }
    further_signatures: ClassVar[Mapping[str, Signatures]] = {
        "ScheduledExecution": {
            "InstantiateScheduledExecution": (_P, (_S, _S, _S, _B, _B, _P, _P, _P, _P, _P)),
            "ActivateModelPartition": (_I, (_P, ctypes.c_uint32, _D)),
        }
    }
    on_clock_update: Callable[[], None]  # of Scheduled Execution; the component sets it
    locks = 0  # of preemption, less the unlocks

    def _instantiate(self, logging_on: bool) -> int | None:
        # Shared with the stepping loop in C: 1 while the instance is in Event Mode.
        self._in_event_mode = ctypes.c_int32(0)
        self.clock_starts: dict[str, ClockStart] = {}
        resources = self.archive.folder / "resources"
        path = f"{resources}{os.sep}".encode() if resources.is_dir() else None
        name, token = self.path.encode(), self.description.token.encode()
        log = self._log.environment, self._log.address("uuv_log_fmi3")
        instance: int | None
        if self.archive.interface == "ModelExchange":
            instantiate = self._library.function("InstantiateModelExchange")
            instance = instantiate(name, token, path, False, logging_on, *log)
            return instance
        if self.archive.interface == "ScheduledExecution":
            self._callbacks = (  # kept, as the FMU calls them
                ctypes.CFUNCTYPE(None, _P)(lambda _: self.on_clock_update()),
                ctypes.CFUNCTYPE(None)(lambda: self._lock(1)),
                ctypes.CFUNCTYPE(None)(lambda: self._lock(-1)),
            )
            instantiate = self._library.function("InstantiateScheduledExecution")
            instance = instantiate(name, token, path, False, logging_on, *log, *self._callbacks)
            return instance
        instance = self._library.function("InstantiateCoSimulation")(
            name,
            token,
            path,
            False,  # visible
            logging_on,
            self.archive.events,  # eventModeUsed
            self.archive.events,  # earlyReturnAllowed
            None,
            0,
            *log,
            None,
        )
        return instance

    def _lock(self, count: int) -> None:
        self.locks += count

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Enter Initialization Mode, after start values have been set."""
        self.time = start_time
        stop = (False, 0.0) if stop_time is None else (True, stop_time)
        self.call("EnterInitializationMode", False, 0.0, start_time, *stop)
        self.phase = Phase.INITIALIZATION

    def exit_initialization_mode(self) -> None:
        """Leave Initialization Mode; with Event Mode, update discrete states, and step then.

        An FMU with clocks stays in Event Mode: the loop reads the clocks that tick at the start.
        """
        if self._has_ticks:
            self.clock_starts = self._start_clocks()
        super().exit_initialization_mode()
        if self._has_ticks:
            self._in_event_mode.value = 1
        elif self.archive.events:
            self._update_discrete_states()

    def set(self, variable: Variable, value: object) -> None:
        """Set a value; between steps, an FMU that uses Event Mode is in it meanwhile.

        One with clocks stays there until the loop has made an event iteration.
        """
        if not self.archive.events or self.phase is not Phase.STEP:
            super().set(variable, value)
            return
        if not self._in_event_mode.value:
            self.call("EnterEventMode")
        super().set(variable, value)
        if self._has_ticks:
            self._in_event_mode.value = 1
        else:
            self._update_discrete_states()

    @property
    def _has_ticks(self) -> bool:
        return self.archive.events and bool(self.description.clocks)

    def _start_clocks(self) -> dict[str, ClockStart]:
        """Return when the time-based clocks begin to tick, in Initialization Mode."""
        found: dict[str, ClockStart] = {}
        for v in self.description.clocks:
            timing = v.timing
            if timing is None or not timing.is_time_based or v.causality != "input":
                continue
            interval, shift = timing.interval, timing.shift
            if interval is None or not timing.is_periodic:
                interval = self._seconds(v, "Interval")
                shift = self._seconds(v, "Shift") or shift if timing.is_periodic else shift
            elif timing.variability != "constant" and self._library.has("SetIntervalDecimal"):
                reference = ctypes.c_uint32(v.value_references[0])
                seconds = ctypes.c_double(float(interval))
                self.call("SetIntervalDecimal", ctypes.byref(reference), 1, ctypes.byref(seconds))
            least = "more than 0 s" if timing.is_periodic else "0 s or more"
            fits = interval is None or interval > 0 or (interval == 0 and not timing.is_periodic)
            if not fits or shift < 0 or (interval is None and timing.is_periodic):
                text = "not known" if interval is None else f"{float(interval):g} s"
                raise FmuError(
                    f"{self.path}.{v.name}",
                    f"at t = {self.time:g} s, its interval is {text} and its shift "
                    f"{float(shift):g} s",
                    f"an interval of {least}, and a shift of 0 s or more",
                )
            found[v.name] = ClockStart(timing.is_periodic, interval, shift)
        return found

    def _seconds(self, clock: Variable, what: str) -> Fraction | None:
        """Ask for a clock's Interval or Shift [s]; None if an interval is not known yet."""
        reference = ctypes.c_uint32(clock.value_references[0])
        number, counter, resolution = ctypes.c_double(), ctypes.c_uint64(), ctypes.c_uint64()
        qualifier = ctypes.c_int(_CHANGED)
        fraction = clock.timing is not None and clock.timing.supports_fraction
        values = (counter, resolution) if fraction else (number,)
        more = (qualifier,) if what == "Interval" else ()
        self.call(
            f"Get{what}{'Fraction' if fraction else 'Decimal'}", ctypes.byref(reference), 1,
            *map(ctypes.byref, (*values, *more)),
        )  # fmt: skip
        if qualifier.value == _UNKNOWN:
            return None
        if fraction:
            return Fraction(counter.value, resolution.value) if resolution.value else None
        if not math.isfinite(number.value):
            text = f"at t = {self.time:g} s, its {what.lower()} is {number.value} s"
            raise FmuError(f"{self.path}.{clock.name}", text, "a finite number")
        return Fraction(repr(number.value))

    def reset(self) -> None:
        """Go back to the state after instantiation; the library stays loaded."""
        super().reset()
        self._in_event_mode.value = 0

    def get_fmu_state(self) -> FmuState:
        """Copy the state; raises FmuError if the FMU cannot."""
        state = super().get_fmu_state()
        state.in_event_mode = self._in_event_mode.value
        return state

    def set_fmu_state(self, state: FmuState) -> None:
        """Restore a state of this instance, and the phase in which it was copied."""
        super().set_fmu_state(state)
        self._in_event_mode.value = state.in_event_mode

    def serialize_fmu_state(self, state: FmuState) -> bytes:
        """Convert a state to bytes, which another instance of this FMU can read."""
        data = super().serialize_fmu_state(state)
        return bytes([data[0] | _IN_EVENT_MODE * state.in_event_mode]) + data[1:]

    def deserialize_fmu_state(self, data: bytes) -> FmuState:
        """Convert bytes to a state of this instance."""
        inside = bool(data) and data[0] & _IN_EVENT_MODE
        phase = data[:1] if not inside else bytes([data[0] & ~_IN_EVENT_MODE])
        state = super().deserialize_fmu_state(phase + data[1:])
        state.in_event_mode = int(bool(inside))
        return state

    def binding(self) -> Binding:
        """Return the addresses that the stepping loop in C calls."""
        binding = super().binding()
        if not binding.functions:
            return binding
        flag = {"InEventMode": ctypes.addressof(self._in_event_mode)}
        return replace(binding, functions={**binding.functions, **flag})

    def _update_discrete_states(self) -> None:
        """Update discrete states until no round is needed, and enter Step Mode."""
        flags, time = [ctypes.c_bool() for _ in range(5)], ctypes.c_double()
        for _ in range(_ROUNDS):
            self.call("UpdateDiscreteStates", *map(ctypes.byref, flags), ctypes.byref(time))
            if flags[1].value:
                raise ComponentFailed(self.path, self.time, "it asks to end the simulation", True)
            if not flags[0].value:
                self.call("EnterStepMode")
                return
        raise ComponentFailed(
            self.path,
            self.time,
            f"after {_ROUNDS} rounds of fmi3UpdateDiscreteStates it needs another; expected an "
            "event iteration that ends",
        )

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance by one communication step; raises ComponentFailed with the FMU's message."""
        time = self.time = current_communication_point
        event, end, early = ctypes.c_bool(), ctypes.c_bool(), ctypes.c_bool()
        reached = ctypes.c_double(time + step_size)
        self.call(
            "DoStep",
            time,
            step_size,
            self.never_goes_back,  # noSetFMUStatePriorToCurrentPoint
            ctypes.byref(event),
            ctypes.byref(end),
            ctypes.byref(early),
            ctypes.byref(reached),
        )
        if end.value:
            raise ComponentFailed(self.path, reached.value, "it asks to end the simulation", True)
        if early.value:
            raise ComponentFailed(
                self.path, reached.value, "fmi3DoStep returned early, which was not allowed"
            )

    def _access(self, variable: Variable) -> Access:
        if variable.type == "Binary":
            return BinaryAccess(variable)
        if variable.type == "String":
            return StringAccess(variable, "String", counts_values=True)
        if variable.type == "Clock":
            return NumericAccess(variable, "Clock", np.bool_, counts_values=False)
        suffix = "Int64" if variable.type == "Enumeration" else variable.type
        return NumericAccess(variable, suffix, DTYPES[variable.type], counts_values=True)
