"""Parent's side of an isolated component: the stepping loop steps it through shared memory."""

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
from uuvsim_cosim.orchestrator.master.core_library import library

__all__ = ["SPINS", "Exchange", "Serve", "SharedBinding", "shared_binding", "text_capacity"]

SPINS = 2000  # polls of the other side before sleeping; some 60 µs
_TEXT_BYTES = 64 << 20  # of texts and binaries in one exchange; only used pages are allocated
_FAILED, _DIED, _LATE = 1, 2, 3

Serve = Callable[..., object]  # (component, segment, pipe, inputs, outputs, spins)


@final
class Exchange:
    """Memory that the loop and one isolated component share; `address` is C's pointer to it.

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
        capacity = text_capacity([*inputs, *outputs])
        # The memory gets its size before either side maps it.
        size = self._c.uuv_exchange_size(*sizes, capacity)
        if size > os.fstat(segment).st_size:
            os.ftruncate(segment, size)
        if not self._c.uuv_exchange_map(self.address, segment, *sizes, capacity):
            raise UuvsimError(
                f"{component.path}: {capacity} bytes of shared memory cannot be mapped"
            )
        affinity = getattr(os, "sched_getaffinity", None)
        cores = len(affinity(0)) if affinity is not None else os.cpu_count() or 1
        spins = SPINS if cores > 1 else 0  # on a single core, polling would block the other side
        self._c.uuv_exchange_waits(self.address, process, component.watchdog or 0.0, spins)
        names = ([v.name for v in inputs], [v.name for v in outputs])
        component.serve(self, self._serve, (*names, spins))

    def exchange_with(self, component: Isolated) -> None:
        """Step another instance of the same FMU from now on."""
        self._component.unserved(self)  # the old instance must not close this exchange
        self._component = component
        if self._shown is not None:
            self.open(*self._shown)

    def leave(self) -> None:
        """Stop stepping, so that the process answers on its pipe again."""
        self._c.uuv_exchange_leave(self.address)

    def close(self) -> None:
        """Release the memory."""
        self._c.uuv_exchange_close(self.address)

    def messages_wait(self) -> bool:
        """Return whether there are messages of the component to be read."""
        return bool(self._c.uuv_exchange_messages(self.address))

    def error(self, time: float) -> BaseException | None:
        """Return the error if the component stopped the loop; None if the loop stopped itself."""
        status = self._c.uuv_exchange_trouble(self.address)
        if status in (_DIED, _LATE):
            return self._component.lost(time, late=status == _LATE)
        return self._component.why(time) if status == _FAILED else None

    def __del__(self) -> None:
        if getattr(self, "address", None):
            self._c.uuv_exchange_free(self.address)


@dataclass(frozen=True)
class SharedBinding(Binding):
    """Binding to another process, in which the component has a binding of the kind `served`."""

    exchange: Exchange
    served: BindingKind


def shared_binding(component: Component, serve: Serve) -> SharedBinding:
    """Return the binding of an isolated component; its exchange is opened later."""
    assert isinstance(component, Isolated)
    exchange, c = Exchange(component, serve), library()
    functions = {"DoStep": exchange.address}  # not a function: C steps through the exchange
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


def text_capacity(variables: Sequence[Variable]) -> int:
    """Return the bytes for texts and binaries in each direction."""
    return _TEXT_BYTES if any(v.type in ("String", "Binary") for v in variables) else 0


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0
