"""Parent process of an isolated component: the stepping loop reaches it by shared memory."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, final

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.isolation.isolated import Isolated
from uuvsim_cosim.orchestrator.master.core import library

__all__ = ["SPINS", "Exchange", "Serve", "SharedBinding", "shared_binding", "text_room"]

SPINS = 2000  # looks at the other side before sleeping; some 60 µs
_TEXT_ROOM = 64 << 20  # bytes of texts and binaries in one exchange; touched only as far as used
_FAILED, _DIED, _LATE = 1, 2, 3

Serve = Callable[..., Any]  # (component, segment, pipe, inputs, outputs, spins)


@final
class Exchange:
    """The memory that the loop and one isolated component share; `address` is what C knows.

    `serve` is called in the component's process, which steps the component from then on (see
    `serving.serve`).
    """

    def __init__(self, component: Isolated, serve: Serve) -> None:
        self._c = library()
        self._component = component
        self._serve = serve
        self._shown: tuple[Sequence[Variable], Sequence[Variable]] | None = None
        self.address: int = self._c.uuv_exchange_new()
        if not self.address:
            raise UuvsimError(f"{component.path}: no memory for its exchange")

    def open(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> None:
        """Share the slots of these variables, which come in the order of the tables."""
        self._shown = inputs, outputs
        component = self._component
        segment, process = component.segment, component.process
        if segment is None or process is None:
            raise UuvsimError(f"{component.path}: its process is gone, or shares no memory")
        sizes = [sum(v.size for v in group) for group in (inputs, outputs)]
        room = text_room([*inputs, *outputs])
        os.ftruncate(segment, self._c.uuv_exchange_size(*sizes, room))
        if not self._c.uuv_exchange_map(self.address, segment, *sizes, room):
            raise UuvsimError(f"{component.path}: {room} bytes of shared memory cannot be mapped")
        spins = SPINS if _cores() > 1 else 0
        self._c.uuv_exchange_waits(self.address, process, component.watchdog or 0.0, spins)
        names = ([v.name for v in inputs], [v.name for v in outputs])
        component.serve(self, self._serve, (*names, spins))

    def exchange_with(self, component: Isolated) -> None:
        """Step another instance of the same from now on; the one before steps no more."""
        self._component.unserved(self)  # it must not close what is the other's from now on
        self._component = component
        if self._shown is not None:
            self.open(*self._shown)

    def leave(self) -> None:
        """Let the process answer on its pipe."""
        self._c.uuv_exchange_leave(self.address)

    def close(self) -> None:
        """Release the memory."""
        self._c.uuv_exchange_close(self.address)

    def messages_wait(self) -> bool:
        """Return whether messages of the component are waiting."""
        return bool(self._c.uuv_exchange_messages(self.address))

    def error(self, time: float) -> BaseException | None:
        """Return the error if the component stopped the loop; None if the loop stopped itself."""
        trouble = self._c.uuv_exchange_trouble(self.address)
        if trouble in (_DIED, _LATE):
            return self._component.lost(time, late=trouble == _LATE)
        return self._component.why(time) if trouble == _FAILED else None

    def __del__(self) -> None:
        if getattr(self, "address", None):
            self._c.uuv_exchange_free(self.address)


@dataclass(frozen=True)
class SharedBinding(Binding):
    """A binding to another process, in which the component is of the kind `served`."""

    exchange: Exchange
    served: BindingKind


def shared_binding(component: Component, serve: Serve) -> SharedBinding:
    """Return the binding of an isolated component, whose exchange is still to be opened."""
    assert isinstance(component, Isolated)
    exchange, c = Exchange(component, serve), library()
    functions = {"DoStep": exchange.address}  # C knows what to call
    if component.description.can_get_and_set_state:
        functions["GetFMUState"] = _address(c.uuv_exchange_save)
        functions["SetFMUState"] = _address(c.uuv_exchange_restore)
    served = component.ask(kind_of)
    return SharedBinding(
        BindingKind.SHARED, exchange.address, functions, exchange, BindingKind(served)
    )


def kind_of(component: Component) -> int:
    """Return the kind of a component's binding; called in its process."""
    return int(component.binding().kind)


def text_room(variables: Sequence[Variable]) -> int:
    """Return the bytes that both sides keep for texts and binaries, each way."""
    return _TEXT_ROOM if any(v.type in ("String", "Binary") for v in variables) else 0


def _cores() -> int:
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity is not None else os.cpu_count() or 1


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0
