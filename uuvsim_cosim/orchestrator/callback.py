"""Any component, whatever its kind, stepped by the loop in C through C callbacks."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.core import by_type
from uuvsim_cosim.orchestrator.slots import decode, encode

__all__ = ["CallbackBinding", "Callbacks", "component_binding"]

_DO_STEP = ctypes.CFUNCTYPE(
    ctypes.c_int32, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_void_p
)
_STATE = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p)
_GET = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p)


class Callbacks:
    """The callbacks of one component; an exception in them is kept in `error`."""

    def __init__(self, component: Component) -> None:
        self.error: BaseException | None = None
        self._component = component
        self._inputs = _Row(component.description.of("input"))
        self._outputs = _Row(component.description.of("output", "local"))
        self.do_step = _DO_STEP(self._do_step)
        self.get = _GET(self._get)
        self.get_state = _STATE(lambda _: self._kept(self._get_state))
        self.set_state = _STATE(lambda _: self._kept(self._set_state))
        self._state: Any = None

    def serve(self, component: Component) -> None:
        """Call another instance of the same from now on."""
        self._component = component
        self.forget()

    def forget(self) -> None:
        """Set every input at the next step, also those that have not changed."""
        self._inputs.last[:] = None

    def _get_state(self) -> None:
        self._state = self._component.get_fmu_state()

    def _set_state(self) -> None:
        self._component.set_fmu_state(self._state)
        self.forget()

    def _kept(self, call: Callable[[], None]) -> int:
        try:
            call()
        except BaseException as error:  # raised again by the master, outside C
            self.error = error
            return 3
        return 0

    def _do_step(self, user: int | None, t: float, h: float, slots: int) -> int:
        try:
            row = self._inputs
            for k, (variable, raw) in enumerate(row.of(slots)):
                bits = raw.tobytes()
                if variable.type in ("String", "Binary") or row.last[k] != bits:
                    self._component.set(variable, decode(variable, raw))
                    row.last[k] = bits
            self._component.do_step(t, h)
        except BaseException as error:  # raised again by the master, outside C
            self.error = error
            return 3
        return 0

    def _get(self, user: int | None, slots: int) -> int:
        try:
            for variable, raw in self._outputs.of(slots):
                encode(variable, self._component.get(variable), raw)
        except BaseException as error:  # raised again by the master, outside C
            self.error = error
            return 3
        return 0


class _Row:
    """Variables that lie one after another in slots; views are made once for each address."""

    def __init__(self, variables: list[Variable]) -> None:
        self.variables = by_type(variables)
        self.last: np.ndarray = np.full(len(variables), None, object)
        self._views: dict[int, list[tuple[Variable, np.ndarray]]] = {}

    def of(self, address: int) -> list[tuple[Variable, np.ndarray]]:
        if not self.variables:
            return []
        if address not in self._views:
            size = sum(v.size for v in self.variables)
            pointer = ctypes.cast(address, ctypes.POINTER(ctypes.c_uint64))
            raw = np.ctypeslib.as_array(pointer, (size,))
            views, first = [], 0
            for v in self.variables:
                views.append((v, raw[first : first + v.size]))
                first += v.size
            self._views[address] = views
        return self._views[address]


@dataclass(frozen=True)
class CallbackBinding(Binding):
    """A binding that keeps its callbacks alive."""

    callbacks: Callbacks


def component_binding(component: Component) -> CallbackBinding:
    """Give the binding of a component that is stepped through Python."""
    callbacks = Callbacks(component)
    functions = {
        "DoStep": ctypes.cast(callbacks.do_step, ctypes.c_void_p).value or 0,
        "Get": ctypes.cast(callbacks.get, ctypes.c_void_p).value or 0,
        "GetFMUState": ctypes.cast(callbacks.get_state, ctypes.c_void_p).value or 0,
        "SetFMUState": ctypes.cast(callbacks.set_state, ctypes.c_void_p).value or 0,
    }
    return CallbackBinding(BindingKind.CALLBACK, 0, functions, callbacks)
