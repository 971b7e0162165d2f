"""Callbacks through which the stepping loop in C calls the Python methods of a component."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.fmus.component import Binding, BindingKind, Component, ExchangesRows
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.master.core_library import by_type, decode, encode

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

__all__ = ["CallbackBinding", "Callbacks", "component_binding"]

_DO_STEP = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_void_p
)
_STATE = ctypes.CFUNCTYPE(None, ctypes.c_void_p)
_GET = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


def _keeping_errors(method: Callable[..., None]) -> Callable[..., None]:
    """Let a callback keep its exception: the master raises it again, outside C."""

    def call(self: Callbacks, *arguments: Any) -> None:
        try:
            method(self, *arguments)
            self.status.value = 0
        except BaseException as error:
            self.error = error

    return call


class Callbacks:
    """Callbacks of one component; an exception in them is kept in `error`.

    The loop in C sets `status` to an error before each call, and a complete call sets it to 0. A
    returned status would not be enough: a signal that arrives while C code runs is raised at the
    first line of the callback, outside of its `try`. ctypes then prints the exception and returns
    the value of the previous call, so that an interruption would be lost.
    """

    def __init__(self, component: Component) -> None:
        _keep_escaped_errors()
        self.error: BaseException | None = None
        self.status = ctypes.c_int32()
        self._component = component
        self._rows = component if isinstance(component, ExchangesRows) else None
        self._inputs = _Row(component.description.of("input"))
        self._outputs = _Row(component.description.of("output", "local"))
        self.do_step = _DO_STEP(self._do_step)
        self.get = _GET(self._get)
        self.get_state = _STATE(self._get_state)
        self.set_state = _STATE(self._set_state)
        self._state: object = None

    def serve(self, component: Component) -> None:
        """Call another instance of the same component from now on."""
        self._component = component
        self._rows = component if isinstance(component, ExchangesRows) else None
        self.forget()

    def forget(self) -> None:
        """Set every input at the next step, also those that have not changed."""
        self._inputs.last[:] = None

    @_keeping_errors
    def _get_state(self, user: int | None) -> None:
        self._state = self._component.get_fmu_state()

    @_keeping_errors
    def _set_state(self, user: int | None) -> None:
        self._component.set_fmu_state(self._state)
        self.forget()

    @_keeping_errors
    def _do_step(self, user: int | None, t: float, h: float, slots: int) -> None:
        row = self._inputs
        if self._rows is not None:
            self._rows.set_row(ctypes.string_at(slots, row.size))
            self._component.do_step(t, h)
            return
        for k, (variable, raw) in enumerate(row.of(slots)):
            bits = raw.tobytes()
            # Setting a value costs more than the comparison. The slot of a text is a pointer, which
            # may stay the same while the text changes.
            if variable.type in ("String", "Binary") or row.last[k] != bits:
                self._component.set(variable, decode(variable, raw))
                row.last[k] = bits
        self._component.do_step(t, h)

    @_keeping_errors
    def _get(self, user: int | None, slots: int) -> None:
        if self._rows is not None:
            ctypes.memmove(slots, self._rows.get_row(), self._outputs.size)
            return
        for variable, raw in self._outputs.of(slots):
            encode(variable, self._component.get(variable), raw)


def _keep_escaped_errors() -> None:
    """Install a hook that keeps an exception which escapes from a callback in its `error`.

    Without it, ctypes would only print the exception.
    """
    before = sys.unraisablehook
    if getattr(before, "keeps_escaped_errors", False):
        return

    def hook(unraisable: UnraisableHookArgs) -> None:
        callbacks = getattr(unraisable.object, "__self__", None)
        if isinstance(callbacks, Callbacks):
            callbacks.error = unraisable.exc_value
        else:
            before(unraisable)

    hook.keeps_escaped_errors = True  # type: ignore[attr-defined]
    sys.unraisablehook = hook


class _Row:
    """Variables in consecutive slots; their views are made once for each address."""

    def __init__(self, variables: list[Variable]) -> None:
        self.variables = by_type(variables)
        self.size = 8 * sum(v.size for v in variables)  # bytes
        self.last: np.ndarray = np.full(len(variables), None, object)
        self._views: dict[int, list[tuple[Variable, np.ndarray]]] = {}

    def of(self, address: int) -> list[tuple[Variable, np.ndarray]]:
        if self.variables and address not in self._views:
            ends = np.cumsum([v.size for v in self.variables])
            pointer = ctypes.cast(address, ctypes.POINTER(ctypes.c_uint64))
            parts = np.split(np.ctypeslib.as_array(pointer, (int(ends[-1]),)), ends[:-1])
            self._views[address] = list(zip(self.variables, parts, strict=True))
        return self._views.get(address, [])


@dataclass(frozen=True)
class CallbackBinding(Binding):
    """Binding that keeps a reference to its callbacks, because C only has their addresses."""

    callbacks: Callbacks


def component_binding(component: Component) -> CallbackBinding:
    """Return the binding of a component that is stepped through Python."""
    callbacks = Callbacks(component)
    pointers = {"DoStep": callbacks.do_step, "Get": callbacks.get,
                "GetFMUState": callbacks.get_state, "SetFMUState": callbacks.set_state}  # fmt: skip
    functions = {n: ctypes.cast(p, ctypes.c_void_p).value or 0 for n, p in pointers.items()}
    address = ctypes.addressof(callbacks.status)
    return CallbackBinding(BindingKind.CALLBACK, address, functions, callbacks)
