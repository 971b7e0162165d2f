"""An instance of an FMI 3.0 FMU in this process."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping
from typing import ClassVar, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.fmus.codegen.toolchain import Signatures
from uuvsim_cosim.fmus.component import BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.importer.fmu_access import Access, BinaryAccess, NumericAccess, StringAccess
from uuvsim_cosim.fmus.importer.fmu_binary import COMMON, FmuBinary, Phase

__all__ = ["Fmu3"]

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
_VALUES = (_I, (_P, _P, _Z, _P, _Z))


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
            "GetIntervalDecimal": (_I, (_P, _P, _Z, _P, _P)),
            "GetShiftDecimal": (_I, (_P, _P, _Z, _P)),
        }
    }
    on_clock_update: Callable[[], None]  # of Scheduled Execution; the component sets it
    locks = 0  # of preemption, less the unlocks

    def _instantiate(self, logging_on: bool) -> int | None:
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
        """Leave Initialization Mode; with Event Mode, update discrete states, and step then."""
        super().exit_initialization_mode()
        if self.archive.events:
            self._update_discrete_states()

    def set(self, variable: Variable, value: object) -> None:
        """Set a value; between steps, an FMU that uses Event Mode is in it meanwhile."""
        if not self.archive.events or self.phase is not Phase.STEP:
            super().set(variable, value)
            return
        self.call("EnterEventMode")
        super().set(variable, value)
        self._update_discrete_states()

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
