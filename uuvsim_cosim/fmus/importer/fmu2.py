"""An instance of an FMI 2.0 FMU in this process."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import ClassVar, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.fmus.codegen.toolchain import Signatures
from uuvsim_cosim.fmus.component import BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.fmu_access import Access, scalar_access
from uuvsim_cosim.fmus.importer.fmu_binary import COMMON, FmuBinary, Phase

__all__ = ["Fmu2"]

_P, _I, _D, _Z, _S = (
    ctypes.c_void_p,
    ctypes.c_int,
    ctypes.c_double,
    ctypes.c_size_t,
    ctypes.c_char_p,
)
_VALUES = (_I, (_P, _P, _Z, _P))
_TYPES = {"ModelExchange": 0, "CoSimulation": 1}
_LAST_SUCCESSFUL_TIME, _TERMINATED, _DISCARD = 2, 3, 2


class _Callbacks(ctypes.Structure):
    """``fmi2CallbackFunctions``."""

    _fields_ = (
        ("logger", _P),
        ("allocate_memory", _P),
        ("free_memory", _P),
        ("step_finished", _P),
        ("environment", _P),
    )


@final
class Fmu2(FmuBinary):
    """The `Component` protocol over FMI 2.0's functions."""

    prefix = "fmi2"
    kind = BindingKind.FMI2
    state_word = "FMUstate"
    deserialize = "DeSerializeFMUstate"
    counts_values = False
    signatures: ClassVar[Signatures] = {
        **COMMON,
        "Instantiate": (_P, (_S, _I, _S, _S, _P, _I, _I)),
        "SetupExperiment": (_I, (_P, _I, _D, _D, _I, _D)),
        "EnterInitializationMode": (_I, (_P,)),
        **{f"Get{t}": _VALUES for t in ("Real", "Integer", "Boolean", "String")},
        **{f"Set{t}": _VALUES for t in ("Real", "Integer", "Boolean", "String")},
        "GetFMUstate": (_I, (_P, _P)),
        "SetFMUstate": (_I, (_P, _P)),
        "FreeFMUstate": (_I, (_P, _P)),
        "SerializedFMUstateSize": (_I, (_P, _P, _P)),
        "SerializeFMUstate": (_I, (_P, _P, _P, _Z)),
        "DeSerializeFMUstate": (_I, (_P, _P, _Z, _P)),
        "GetDirectionalDerivative": (_I, (_P, _P, _Z, _P, _Z, _P, _P)),
        "DoStep": (_I, (_P, _D, _D, _I)),
        "GetBooleanStatus": (_I, (_P, _I, _P)),
        "GetRealStatus": (_I, (_P, _I, _P)),
        "GetDerivatives": (_I, (_P, _P, _Z)),
        "NewDiscreteStates": (_I, (_P, _P)),
        "CompletedIntegratorStep": (_I, (_P, _I, _P, _P)),
    }

    def _instantiate(self, logging_on: bool) -> int | None:
        log = self._log
        self._before: dict[str, tuple[Variable, object]] = {}  # set before Initialization Mode
        # The FMU keeps the pointer, so the structure must live as long as the instance.
        self._callbacks = _Callbacks(
            log.address("uuv_log_fmi2"),
            log.address("uuv_allocate"),
            log.address("uuv_release"),
            None,
            log.environment,
        )
        instance: int | None = self._library.function("Instantiate")(
            self.path.encode(),
            _TYPES[self.archive.interface],
            self.description.token.encode(),
            (self.archive.folder / "resources").as_uri().encode(),
            ctypes.addressof(self._callbacks),
            0,
            int(logging_on),
        )
        return instance

    def set(self, variable: Variable, value: object) -> None:
        """Set a value; before Initialization Mode, it is set again on entering that mode."""
        super().set(variable, value)
        if self.phase is Phase.INSTANTIATED:
            self._before[variable.name] = (variable, value)

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Enter; values are set again, as some foreign FMUs lose them in SetupExperiment."""
        self.time = start_time
        stop = (0, 0.0) if stop_time is None else (1, stop_time)
        self.call("SetupExperiment", 0, 0.0, start_time, *stop)
        for variable, value in self._before.values():
            super().set(variable, value)
        self._before.clear()
        self.call("EnterInitializationMode")
        self.phase = Phase.INITIALIZATION

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance by one communication step; raises ComponentFailed with the FMU's message."""
        time = self.time = current_communication_point
        status = self._library.function("DoStep")(
            self._live(), time, step_size, int(self.never_goes_back)
        )
        if status > 1 or status < 0:
            raise self.failure("DoStep", status, time)
        self._log.drain()

    def failure(self, function: str, status: int, time: float) -> ComponentFailed:
        """Return the error for a status; an FMU may discard a step to end the simulation."""
        error = super().failure(function, status, time)
        if function != "DoStep" or status != _DISCARD or not self._library.has("GetBooleanStatus"):
            return error
        asks = ctypes.c_int(0)
        answered = self._library.function("GetBooleanStatus")(
            self._live(), _TERMINATED, ctypes.byref(asks)
        )
        if answered != 0 or asks.value == 0:
            return error
        if self._library.has("GetRealStatus"):
            reached = ctypes.c_double(time)
            answered = self._library.function("GetRealStatus")(
                self._live(), _LAST_SUCCESSFUL_TIME, ctypes.byref(reached)
            )
            if answered == 0 and reached.value >= time:
                time = reached.value
        reason = f"{error.reason} (it asks to end the simulation)"
        return ComponentFailed(self.path, time, reason, asks_to_end=True)

    def _access(self, variable: Variable) -> Access:
        return scalar_access(variable, _NUMERIC)


_NUMERIC: Mapping[str, tuple[str, type]] = {
    "Float64": ("Real", np.float64),
    "Int32": ("Integer", np.int32),
    "Enumeration": ("Integer", np.int32),
    "Boolean": ("Boolean", np.int32),
}
