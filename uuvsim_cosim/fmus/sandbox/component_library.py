"""A component of FMI-LS-WASM in wasmtime behind the functions of FMI 3.0's C interface.

It serves components of any tool. Each call goes through Python and the component model, which costs
tens of microseconds; components of this package are called directly (`library.py`).
"""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.codegen.toolchain import Signatures
from uuvsim_cosim.fmus.importer.fmu_library import FmuLibrary
from uuvsim_cosim.fmus.importer.message_log import STATUS
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.sandbox.engine import engine, interrupted, ticks_of
from uuvsim_cosim.fmus.sandbox.host import Host

__all__ = ["ComponentLibrary"]

_PACKAGE = "fmi:fmi3/{}@3.0.0"
_FATAL = STATUS.index("fatal")
_LOG = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int32, ctypes.c_char_p, ctypes.c_char_p)
_numbers = itertools.count()
_TYPES: dict[str, Any] = {
    "Float32": ctypes.c_float, "Float64": ctypes.c_double, "Boolean": ctypes.c_bool,
    "Int8": ctypes.c_int8, "Int16": ctypes.c_int16, "Int32": ctypes.c_int32,
    "Int64": ctypes.c_int64, "UInt8": ctypes.c_uint8, "UInt16": ctypes.c_uint16,
    "UInt32": ctypes.c_uint32, "UInt64": ctypes.c_uint64, "Clock": ctypes.c_bool,
}  # fmt: skip
# Functions without arguments, and those with one vector of doubles.
_PLAIN = {
    "ExitInitializationMode": "exit-initialization-mode",
    "EnterConfigurationMode": "enter-configuration-mode",
    "ExitConfigurationMode": "exit-configuration-mode",
    "EnterEventMode": "enter-event-mode",
    "EnterContinuousTimeMode": "enter-continuous-time-mode",
    "Terminate": "terminate",
    "Reset": "reset",
}
_VECTORS = {
    "GetContinuousStates": "get-continuous-states",
    "GetContinuousStateDerivatives": "get-continuous-state-derivatives",
    "GetEventIndicators": "get-event-indicators",
    "GetNominalsOfContinuousStates": "get-nominals-of-continuous-states",
}
_COUNTS = {
    "GetNumberOfContinuousStates": "get-number-of-continuous-states",
    "GetNumberOfEventIndicators": "get-number-of-event-indicators",
}


class _Failed(Exception):
    """A call that returned a status instead of its result."""

    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status


@final
class ComponentLibrary(FmuLibrary):
    """A component with one instance; it gets no files, no network and an empty environment."""

    addressable = False

    def __init__(
        self, file: Path, watchdog: float | None, host: Host,
        archive: FmuArchive, prefix: str, signatures: Signatures,
    ) -> None:  # fmt: skip
        from wasmtime import Store, Trap, WasiConfig, WasmtimeError
        from wasmtime.component import Component, Linker

        self.archive = archive
        self.file = file.with_name(f"{file.name}#{next(_numbers)}")  # no file: one instance
        self._prefix, self._signatures = prefix, signatures
        self._bound = {}
        self._errors = (Trap, WasmtimeError)
        self._host = host
        self._kind = "co-simulation" if archive.interface == "CoSimulation" else "model-exchange"
        self._ticks = ticks_of(watchdog)
        if watchdog is not None:
            interrupted(self)
        self._store = Store(engine())
        self._store.set_limits(host.limit)
        self._store.set_wasi(WasiConfig())
        self._states: dict[int, bytes] = {}
        self._texts: list[Any] = []  # that the caller of a getter reads
        place = str(archive.path)
        linker = Linker(engine())
        linker.add_wasip2()
        try:
            component = Component(engine(), file.read_bytes())
            with linker.root() as root:
                with root.add_instance(_PACKAGE.format("callbacks")) as callbacks:
                    callbacks.add_func("log-message", self._logged)
                    for name in ("clock-update", "lock-preemption", "unlock-preemption"):
                        callbacks.add_func(name, lambda store: None)
                with root.add_instance(_PACKAGE.format("intermediate-update-callbacks")) as more:
                    more.add_func("intermediate-update", lambda store, *given: (False, 0.0))
            self._store.set_epoch_deadline(self._ticks)
            self._component = linker.instantiate(self._store, component)
        except (WasmtimeError, Trap) as error:
            reason = " ".join(str(error).split())[:300]
            raise FmuError(
                place, f"its WebAssembly cannot start ({reason})", "a component of FMI-LS-WASM"
            ) from None
        self._interface = self._component.get_export_index(self._store, _PACKAGE.format(self._kind))
        if self._interface is None:
            raise FmuError(place, f"its component exports no {_PACKAGE.format(self._kind)}", "it")
        self._functions: dict[str, Any] = {}
        self._instance: Any = None
        self._report: Callable[[int, str, str], None] = lambda status, category, text: None

    # ---- the functions of C -------------------------------------------------------------------

    def function(self, name: str) -> Callable[..., Any]:
        """Return a function with the arguments of C."""
        if name.startswith("Instantiate"):
            return self._instantiate
        body = self._body(name)

        def call(instance: int, *given: Any) -> int | None:
            try:
                return body(*given)
            except _Failed as failed:
                return failed.status
            except self._errors as error:
                text = " ".join(str(error).split("Caused by:")[-1].split())
                reason = "it did not answer in time and was interrupted"
                text = reason if "interrupt" in text else f"its WebAssembly failed: {text[:200]}"
                self._report(_FATAL, "", text)
                return _FATAL

        return call

    def has(self, name: str) -> bool:
        """Return whether there is such a function."""
        try:
            self._body(name)
        except FmuError:
            return False
        return True

    def _body(self, name: str) -> Callable[..., int]:
        if name in _PLAIN:
            return lambda: self._does(_PLAIN[name])
        if name in _VECTORS:
            return lambda to, n: _put(to, ctypes.c_double, self._gives(_VECTORS[name]))
        if name in _COUNTS:
            return lambda to: _set(to, self._gives(_COUNTS[name]))
        own = getattr(self, f"_{name}", None)
        if own is not None:
            return own  # type: ignore[no-any-return]
        verb, kind = name[:3], name[3:]
        if kind in _TYPES and verb in ("Get", "Set"):
            getter = verb == "Get"
            of = _TYPES[kind]

            def values(r: Any, n: int, place: Any, count: int | None = None) -> int:
                count = n if count is None else count
                if getter:
                    return _put(place, of, self._gives(f"get-{kind.lower()}", list(r)))
                given = list((of * count).from_address(_address(place)))
                data = bytes(given) if kind == "UInt8" else given
                return self._does(f"set-{kind.lower()}", list(r), data)

            return values
        raise FmuError(
            f"{self.archive.path}: does not export {self._prefix}{name}, which is needed"
        )

    def _instantiate(
        self, name: bytes, token: bytes, folder: bytes | None, *given: Any
    ) -> int | None:
        environment, report = given[-3:-1] if self._kind == "co-simulation" else given[-2:]
        log = _LOG(report)
        self._report = lambda status, category, text: log(
            environment, status, category.encode(), text.encode()
        )
        texts = [name.decode(), token.decode(), "/resources/" if folder else ""]
        flags = [False, bool(given[1])]
        if self._kind == "co-simulation":
            flags += [False, False]
        function = self._named(f"[static]{self._kind}-instance.instantiate-{self._kind}")
        more: list[Any] = [[]] if self._kind == "co-simulation" else []
        try:
            self._store.set_epoch_deadline(self._ticks)
            self._instance = function(self._store, *texts, *flags, *more)
        except self._errors as error:
            self._report(_FATAL, "", " ".join(str(error).split())[:300])
        return None if self._instance is None else 1

    def _FreeInstance(self) -> int:
        instance, self._instance = self._instance, None
        if instance is not None:
            self._store.set_epoch_deadline(self._ticks)
            instance.drop(self._store)
        return 0

    def _EnterInitializationMode(self, has_tolerance: bool, tolerance: float, start: float,
                                 has_stop: bool, stop: float) -> int:  # fmt: skip
        options = (tolerance if has_tolerance else None, start, stop if has_stop else None)
        return self._does("enter-initialization-mode", *options)

    def _DoStep(self, t: float, h: float, never_back: bool, event: Any, end: Any, early: Any,
                reached: Any) -> int:  # fmt: skip
        found = vars(self._gives("do-step", t, h, bool(never_back)))
        _set(event, found["event-handling-needed"])
        _set(end, found["terminate-simulation"])
        _set(early, found["early-return"])
        return _set(reached, found["last-successful-time"])

    def _GetString(self, r: Any, n: int, place: Any, count: int) -> int:
        self._texts = [text.encode() for text in self._gives("get-string", list(r))]
        place[:] = self._texts
        return 0

    def _SetString(self, r: Any, n: int, place: Any, count: int) -> int:
        return self._does("set-string", list(r), [(t or b"").decode() for t in place[:count]])

    def _GetBinary(self, r: Any, n: int, sizes: Any, place: Any, count: int) -> int:
        found = self._gives("get-binary", list(r))
        self._texts = [ctypes.create_string_buffer(bytes(data), len(data) + 1) for data in found]
        for k, data in enumerate(found):
            sizes[k], place[k] = len(data), ctypes.addressof(self._texts[k])
        return 0

    def _SetBinary(self, r: Any, n: int, sizes: Any, place: Any, count: int) -> int:
        data = [ctypes.string_at(place[k], sizes[k]) for k in range(count)]
        return self._does("set-binary", list(r), data)

    def _GetDirectionalDerivative(self, u: Any, nu: int, k: Any, nk: int, seed: Any, n_seed: int,
                                  place: Any, count: int) -> int:  # fmt: skip
        given = list((ctypes.c_double * n_seed).from_address(seed))
        found = self._gives("get-directional-derivative", list(u), list(k), given)
        return _put(place, ctypes.c_double, found)

    # ---- states, which the component gives as bytes -------------------------------------------

    def _GetFMUState(self, place: Any) -> int:
        return _set(place, self._kept(bytes(self._gives("get-fmu-state"))))

    def _SetFMUState(self, number: int) -> int:
        return self._does("set-fmu-state", self._states[number])

    def _FreeFMUState(self, place: Any) -> int:
        self._states.pop(place._obj.value, None)
        return 0

    def _SerializedFMUStateSize(self, number: int, place: Any) -> int:
        return _set(place, len(self._states[number]))

    def _SerializeFMUState(self, number: int, buffer: Any, size: int) -> int:
        ctypes.memmove(buffer, self._states[number], size)
        return 0

    def _DeserializeFMUState(self, buffer: Any, size: int, place: Any) -> int:
        return _set(place, self._kept(buffer.raw[:size]))

    def _kept(self, data: bytes) -> int:
        number = next(_numbers) + 1
        self._states[number] = data
        return number

    # ---- Model Exchange -----------------------------------------------------------------------

    def _SetTime(self, t: float) -> int:
        return self._does("set-time", t)

    def _SetContinuousStates(self, place: Any, n: int) -> int:
        given = list((ctypes.c_double * n).from_address(_address(place)))
        return self._does("set-continuous-states", given)

    def _UpdateDiscreteStates(self, *places: Any) -> int:
        found = vars(self._gives("update-discrete-states"))
        for place, value in zip(places, found.values(), strict=True):
            _set(place, value)
        return 0

    def _CompletedIntegratorStep(self, never_back: bool, event: Any, end: Any) -> int:
        found = vars(self._gives("completed-integrator-step", bool(never_back)))
        _set(event, found["enter-event-mode"])
        return _set(end, found["terminate-simulation"])

    # ---- calls --------------------------------------------------------------------------------

    def _named(self, name: str) -> Any:
        if name not in self._functions:
            index = self._component.get_export_index(self._store, name, self._interface)
            found = None if index is None else self._component.get_func(self._store, index)
            if found is None:
                raise FmuError(f"{self.archive.path}: its component does not export {name}")
            self._functions[name] = found
        return self._functions[name]

    def _called(self, method: str, given: Sequence[object]) -> Any:
        function = self._named(f"[method]{self._kind}-instance.{method}")
        self._store.set_epoch_deadline(self._ticks)
        return function(self._store, self._instance, *given)

    def _does(self, method: str, *given: object) -> int:
        return STATUS.index(self._called(method, given))

    def _gives(self, method: str, *given: object) -> Any:
        found = self._called(method, given)
        if isinstance(found, str):  # an error
            raise _Failed(STATUS.index(found))
        return found

    def _logged(self, store: Any, name: str, status: str, category: str, text: str) -> None:
        self._report(STATUS.index(status), category, text)


def _address(place: Any) -> int:
    return place if isinstance(place, int) else ctypes.cast(place, ctypes.c_void_p).value or 0


def _put(place: Any, of: Any, values: Sequence[Any]) -> int:
    (of * len(values)).from_address(_address(place))[:] = list(values)
    return 0


def _set(place: Any, value: Any) -> int:
    """Write a result to where `ctypes.byref` points."""
    place._obj.value = value
    return 0
