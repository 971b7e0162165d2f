"""An instance of an FMI 1.0 FMU in this process.

FMI 1.0 has no Initialization Mode: values are set before ``fmiInitialize`` and outputs exist after
it. Here the function is called at the first read of an output in Initialization Mode, or at the end
of this mode, so that an FMU gets its inputs first if they can be known.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any, ClassVar, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.codegen.toolchain import Signatures
from uuvsim_cosim.fmus.component import BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.fmu_access import Access, scalar_access
from uuvsim_cosim.fmus.importer.fmu_binary import COMMON, FmuBinary, Phase
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.values import flat_array

__all__ = ["EventInfo", "Fmu1"]

_P, _I, _B, _D, _Z, _S = (
    ctypes.c_void_p,
    ctypes.c_int,
    ctypes.c_int8,  # fmiBoolean is a char
    ctypes.c_double,
    ctypes.c_size_t,
    ctypes.c_char_p,
)
_VALUES = (_I, (_P, _P, _Z, _P))
_LIBRARY = b"application/x-fmu-sharedlibrary"
_LAST_SUCCESSFUL_TIME, _DISCARD, _PENDING = 2, 2, 5


class _Callbacks(ctypes.Structure):
    """``fmiCallbackFunctions``, which is passed by value.

    Model Exchange has no last member. It does not read it either: on all platforms of 64 bits, a
    structure of this size is passed in memory, and the argument after it in a register.
    """

    _fields_ = (
        ("logger", _P),
        ("allocate_memory", _P),
        ("free_memory", _P),
        ("step_finished", _P),
    )


class EventInfo(ctypes.Structure):
    """``fmiEventInfo``."""

    _fields_ = (
        ("converged", ctypes.c_int8),
        ("references_changed", ctypes.c_int8),
        ("values_changed", ctypes.c_int8),
        ("terminate", ctypes.c_int8),
        ("next_defined", ctypes.c_int8),
        ("next_time", ctypes.c_double),
    )


@final
class Fmu1(FmuBinary):
    """The `Component` protocol over FMI 1.0's functions."""

    prefix = "fmi"
    kind = BindingKind.FMI1
    state_word = "FMUState"  # FMI 1.0 has no states
    deserialize = "DeserializeFMUState"
    counts_values = False
    signatures: ClassVar[Signatures] = {
        **{name: COMMON[name] for name in (
            "Terminate", "SetTime", "GetContinuousStates", "SetContinuousStates",
            "GetEventIndicators",
        )},
        **{f"Get{t}": _VALUES for t in ("Real", "Integer", "Boolean", "String")},
        **{f"Set{t}": _VALUES for t in ("Real", "Integer", "Boolean", "String")},
        "InstantiateSlave": (_P, (_S, _S, _S, _S, _D, _B, _B, _Callbacks, _B)),
        "InitializeSlave": (_I, (_P, _D, _B, _D)),
        "TerminateSlave": (_I, (_P,)),
        "ResetSlave": (_I, (_P,)),
        "FreeSlaveInstance": (None, (_P,)),
        "DoStep": (_I, (_P, _D, _D, _B)),
        "GetRealStatus": (_I, (_P, _I, _P)),
        "InstantiateModel": (_P, (_S, _S, _Callbacks, _B)),
        "FreeModelInstance": (None, (_P,)),
        "Initialize": (_I, (_P, _B, _D, _P)),
        "GetDerivatives": (_I, (_P, _P, _Z)),
        "GetNominalContinuousStates": (_I, (_P, _P, _Z)),
        "CompletedIntegratorStep": (_I, (_P, _P)),
        "EventUpdate": (_I, (_P, _B, _P)),
    }  # fmt: skip

    def _exported_prefix(self, archive: FmuArchive) -> str:
        return f"{archive.model_identifier}_{self.prefix}"

    def _instantiate(self, logging_on: bool) -> int | None:
        log = self._log
        log.name(self.path)
        self._logging_on = logging_on
        self._given: dict[str, np.ndarray] = {}  # values that were set before fmiInitialize
        self._initialized = False
        self.first_event: EventInfo | None = None  # of Model Exchange, from fmiInitialize
        self._times: tuple[float, float | None] = (0.0, None)
        callbacks = _Callbacks(
            log.address("uuv_log_fmi1"), log.address("uuv_allocate"), log.address("uuv_release")
        )
        name, guid = self.path.encode(), self.description.token.encode()
        instance: int | None
        if self.archive.interface == "ModelExchange":
            instantiate = self._library.function("InstantiateModel")
            instance = instantiate(name, guid, callbacks, int(logging_on))
        else:
            location = self.archive.folder.as_uri().encode()
            instance = self._library.function("InstantiateSlave")(
                name, guid, location, _LIBRARY, 0.0, 0, 0, callbacks, int(logging_on)
            )
        log.name(self.path, instance)
        return instance

    def _release(self, instance: int | None) -> None:
        model = self.archive.interface == "ModelExchange"
        self._library.function("FreeModelInstance" if model else "FreeSlaveInstance")(instance)

    def get(self, variable: Variable) -> Any:
        """Read a value; before fmiInitialize, an input or a parameter has the value that was set.

        The first read of another variable in Initialization Mode calls fmiInitialize.
        """
        if self.phase is Phase.INITIALIZATION and not self._initialized:
            if variable.causality in ("input", "parameter"):
                access = self._accessed(variable)
                flat = self._given.get(variable.name)
                if flat is None:
                    start = np.zeros(variable.shape) if variable.start is None else variable.start
                    if variable.type == "String" and variable.start is None:
                        start = ""
                    flat = flat_array(variable, start, f"{self.path}.{variable.name}")
                return access.shaped(flat)
            self._initialize()
        return super().get(variable)

    def set(self, variable: Variable, value: object) -> None:
        """Set a value of the variable's shape; raises FmuError for another shape or type."""
        super().set(variable, value)
        if not self._initialized:
            place = f"{self.path}.{variable.name}"
            self._given[variable.name] = flat_array(variable, value, place)

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Keep the times for fmiInitialize."""
        self.time = start_time
        self._times = (start_time, stop_time)
        if self.archive.interface == "ModelExchange":
            self.call("SetTime", start_time)
        self.phase = Phase.INITIALIZATION

    def exit_initialization_mode(self) -> None:
        """Call fmiInitialize unless an output was read before; stepping may begin."""
        if not self._initialized:
            self._initialize()
        self.phase = Phase.STEP

    def _initialize(self) -> None:
        start, stop = self._times
        if self.archive.interface == "ModelExchange":
            self.first_event = EventInfo()
            self.call("Initialize", 0, 0.0, ctypes.byref(self.first_event))
        else:
            self.call("InitializeSlave", start, int(stop is not None), stop or 0.0)
        self._initialized = True
        self._given.clear()

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance by one communication step; raises ComponentFailed with the FMU's message."""
        time = self.time = current_communication_point
        status = self._library.function("DoStep")(self._live(), time, step_size, 1)
        if status > 1 or status < 0:
            raise self.failure("DoStep", status, time)
        self._log.drain()

    def failure(self, function: str, status: int, time: float) -> ComponentFailed:
        """Return the error for a status; a discarded step has the time that the FMU reached."""
        error = super().failure(function, status, time)
        if function != "DoStep" or self.archive.interface == "ModelExchange":
            return error
        if status == _PENDING:
            reason = f"{error.reason}: it steps asynchronously, which is not supported"
            return ComponentFailed(self.path, time, reason)
        if status == _DISCARD and self._library.has("GetRealStatus"):
            reached = ctypes.c_double(time)
            answered = self._library.function("GetRealStatus")(
                self._live(), _LAST_SUCCESSFUL_TIME, ctypes.byref(reached)
            )
            self._log.drain()
            if answered == 0 and reached.value > time:
                reason = f"{error.reason} (it reached t = {reached.value:.9g} s)"
                return ComponentFailed(self.path, reached.value, reason)
        return error

    def reset(self) -> None:
        """Go back to the state after instantiation; Model Exchange makes another instance."""
        if self.archive.interface == "CoSimulation":
            self.call("ResetSlave")
            self._given.clear()
            self._initialized = False
            self.phase = Phase.INSTANTIATED
            return
        self._release(self._live())
        self.phase = Phase.FATAL  # if the next call fails, there is no instance
        self._instance = self._instantiate(self._logging_on)
        messages = self._log.drain()
        if self._instance is None:
            reason = self._log.last(messages)
            raise FmuError(f"{self.path}: could not be instantiated again: {reason}")
        self.phase = Phase.INSTANTIATED

    def terminate(self) -> None:
        """End stepping; does nothing if stepping never began, has ended or has failed."""
        if self.phase is Phase.STEP:
            self.phase = Phase.TERMINATED
            model = self.archive.interface == "ModelExchange"
            self.call("Terminate" if model else "TerminateSlave")

    def _access(self, variable: Variable) -> Access:
        return scalar_access(variable, _NUMERIC)


_NUMERIC: Mapping[str, tuple[str, type]] = {
    "Float64": ("Real", np.float64),
    "Int32": ("Integer", np.int32),
    "Enumeration": ("Integer", np.int32),
    "Boolean": ("Boolean", np.int8),
}
