"""Native components: a declaration is compiled and loaded in this process, without an FMU."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from copy import copy
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.lowering import Lowered, lower
from uuvsim_cosim.fmus.codegen.runtime import runtime, runtime_file
from uuvsim_cosim.fmus.codegen.toolchain import (
    Signatures,
    compile_shared,
    component_flags,
    fmi_headers,
    generated_sources,
    host,
    load_library,
)
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["Native", "compile_native"]


def compile_native(lowered: Lowered) -> Path:
    """Compile a lowered declaration with the runtime; cached.

    The options are those of its FMU, so that zig compiles the same object for both only once.
    """
    return compile_shared(
        [runtime_file("uuv_runtime.c"), *generated_sources(lowered.files)],
        name=lowered.model.name,
        include=[*runtime(), fmi_headers()],
        flags=component_flags(host()),
    )


_P, _Z, _D = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double
_SIGNATURES: Signatures = {  # of uuv_runtime.c
    "uuv_get_component": (_P, []),
    "uuv_instantiate": (_P, [_P]),
    "uuv_free": (None, [_P]),
    "uuv_reset": (None, [_P]),
    "uuv_refresh": (None, [_P]),
    "uuv_enter_initialization": (None, [_P, _D]),
    "uuv_exit_initialization": (None, [_P]),
    "uuv_update_outputs": (None, [_P]),
    "uuv_forward": (None, [_P, _P, _P]),
    "uuv_do_step": (ctypes.c_int32, [_P, _D, _D]),
    "uuv_state_size": (_Z, [_P]),
    "uuv_get_state": (None, [_P, _P]),
    "uuv_set_state": (None, [_P, ctypes.c_char_p]),
}


class Native:
    """An instance of a declaration, which is compiled and loaded in this process, without an FMU.

    `model` is the declaration, `path` the component's name in messages, `library` a library that is
    compiled already. Variables are those of its `description`, values are in their units. Raises
    ToolchainError without a compiler, FmuError after `free`. Order of calls:
    `enter_initialization_mode`, `exit_initialization_mode`, `do_step` from one communication point
    to the next, `free`.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.fmus import Native
    >>> motor = Native(uuv.declare("thruster_t200"), "motor")
    >>> u, thrust, current = map(motor.description.variables.get, ("u", "thrust", "current"))
    >>> motor.enter_initialization_mode(0.0, None)
    >>> motor.exit_initialization_mode()
    >>> still = motor.get_fmu_state()
    >>> motor.set(u, 0.5)
    >>> for k in range(100):
    ...     motor.do_step(k * 0.01, 0.01)
    >>> motor.check_outputs(1.0)
    >>> f"{motor.get(thrust):.2f} N", f"{motor.view(thrust):.2f} N"
    ('17.85 N', '17.85 N')
    >>> motor.directional_derivative([current], [u], [1.0]).round(1)  # d(current)/du [A]
    array([22.2])
    >>> kept = motor.serialize_fmu_state(still)
    >>> motor.set_fmu_state(motor.deserialize_fmu_state(kept))
    >>> motor.get(thrust)
    0.0

    Example: another instance; the loop in C calls an instance by its binding.

    >>> starboard = motor.another("starboard")
    >>> starboard.binding().kind.name
    'NATIVE'
    >>> starboard.reset()
    >>> for instance in (motor, starboard):
    ...     instance.terminate()
    ...     instance.free()
    """

    def __init__(self, model: Model | Lowered, path: str, library: Path | None = None) -> None:
        lowered = model if isinstance(model, Lowered) else lower(model)
        self.description = describe(lowered.model, lowered.equations)
        self._names = {
            p.offset + i: name
            for p in lowered.layout.placed
            for i, name in enumerate(element_names(p.variable.name, p.variable.shape))
        }
        self._size = lowered.layout.size
        self._layout = lowered.layout
        self._c = load_library(library or compile_native(lowered), _SIGNATURES)
        self._instantiate(path)

    def another(self, path: str) -> Native:
        """Make another instance of the same declaration, `path`, without compiling it again."""
        made = copy(self)
        made._instantiate(path)
        return made

    def _instantiate(self, path: str) -> None:
        self.path = path
        self.messages: list[tuple[str, str]] = []
        self._instance: int | None = self._c.uuv_instantiate(self._c.uuv_get_component())
        if not self._instance:
            raise FmuError(f"{path}: no memory for an instance of {self.description.name!r}")
        self._head = _Instance.from_address(self._instance)
        self._block = np.ctypeslib.as_array(
            ctypes.cast(self._head.b, ctypes.POINTER(ctypes.c_double)), (self._size,)
        )

    # ---- values ---------------------------------------------------------------------------

    def get(self, variable: Variable) -> Any:
        """Read the value of a `variable`; outputs are computed first if they are out of date."""
        self._c.uuv_update_outputs(self._live())
        first = variable.value_references[0]
        flat = self._block[first : first + variable.size]
        if variable.type != "Float64":
            flat = flat.astype(bool if variable.type == "Boolean" else np.int32)
        return flat.reshape(variable.shape).copy() if variable.shape else flat[0].item()

    def view(self, variable: Variable) -> np.ndarray:
        """Return a read-only view of a Float64 `variable`'s values, which later steps change.

        Raises FmuError for another type.
        """
        self._c.uuv_update_outputs(self._live())
        if variable.type != "Float64":
            raise FmuError(f"{self.path}.{variable.name}", f"is {variable.type}", "Float64")
        first = variable.value_references[0]
        view = self._block[first : first + variable.size].reshape(variable.shape)
        view.flags.writeable = False
        return view

    def set(self, variable: Variable, value: Any) -> None:
        """Set an input or a parameter, `variable`, to a `value` of its shape.

        Raises FmuError unless it is finite and in [min, max].
        """
        self._live()
        place = f"{self.path}.{variable.name}"
        array = np.asarray(value, dtype=float)
        if array.shape != variable.shape:
            raise FmuError(place, f"value of shape {array.shape}", variable.shape)
        if variable.causality not in ("input", "parameter"):
            raise FmuError(place, f"is {variable.causality}", "an input or a parameter")
        if variable.variability == "fixed" and self._head.initialized:
            raise FmuError(f"{place}: is fixed; it can be set until initialization has ended")
        low = -np.inf if variable.min is None else variable.min
        high = np.inf if variable.max is None else variable.max
        if not np.all(np.isfinite(array) & (array >= low) & (array <= high)):
            raise FmuError(place, f"value {value}", f"finite numbers in [{low}, {high}]")
        first = variable.value_references[0]
        self._block[first : first + variable.size] = array.ravel()
        self._head.outputs_stale = 1
        if variable.causality == "parameter":
            self._head.dirty = 1

    # ---- life cycle -----------------------------------------------------------------------

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Begin at `start_time` [s]; ticks before it are skipped. `stop_time` [s] is not used."""
        self._c.uuv_enter_initialization(self._live(), start_time)

    def exit_initialization_mode(self) -> None:
        """Compute derived values and initial states."""
        self._c.uuv_exit_initialization(self._live())

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Advance from `current_communication_point` [s] by `step_size` [s].

        Raises ComponentFailed, which names the value, if a value is not finite.
        """
        status = self._c.uuv_do_step(self._live(), current_communication_point, step_size)
        if status:
            raise ComponentFailed(
                self.path,
                current_communication_point,
                f"{self._names.get(status - 1, 'a value')} is not finite",
            )

    def check_outputs(self, time: float) -> None:
        """Raise ComponentFailed, which names the output, for one not finite at `time` [s]."""
        self._c.uuv_update_outputs(self._live())
        first = self._layout.offset["output"]
        outputs = self._block[first : first + self._layout.count["output"]]
        if not isfinite(np.add.reduce(outputs)):
            for i in np.flatnonzero(~np.isfinite(outputs)).tolist():
                raise ComponentFailed(self.path, time, f"{self._names[first + i]} is not finite")

    def get_fmu_state(self) -> bytes:
        """Copy the whole state, sample counters included."""
        buffer = ctypes.create_string_buffer(self._c.uuv_state_size(self._live()))
        self._c.uuv_get_state(self._instance, buffer)
        return buffer.raw

    def set_fmu_state(self, state: bytes) -> None:
        """Restore a `state` of this declaration; raises FmuError for another size."""
        if len(state) != self._c.uuv_state_size(self._live()):
            raise FmuError(f"{self.path}: state of {len(state)} bytes is of another component")
        self._c.uuv_set_state(self._instance, state)

    def serialize_fmu_state(self, state: bytes) -> bytes:
        """Return the `state`, which is bytes."""
        return state

    def deserialize_fmu_state(self, data: bytes) -> bytes:
        """Return the state, which is `data`."""
        return data

    def directional_derivative(
        self, unknowns: Sequence[Variable], knowns: Sequence[Variable], seed: ArrayLike
    ) -> np.ndarray:
        """Return d(`unknowns`)/d(`knowns`) · `seed` at the current values, flat.

        Unknowns are outputs and knowns are inputs; `seed` has one number for each of their
        elements. Raises FmuError for other variables.
        """
        layout = self._layout
        n_u, n_x = layout.count["input"], layout.count["state"]
        full = np.zeros(n_u + n_x)
        flat = np.asarray(seed, dtype=float).ravel()
        used = 0
        for v in knowns:
            first = v.value_references[0] - layout.offset["input"]
            if v.causality != "input":
                raise FmuError(f"{self.path}.{v.name}", f"is {v.causality}", "an input")
            full[first : first + v.size] = flat[used : used + v.size]
            used += v.size
        result = np.zeros(layout.count["output"] + n_x)
        self._c.uuv_refresh(self._live())
        self._c.uuv_forward(self._instance, full.ctypes.data, result.ctypes.data)
        parts = []
        for v in unknowns:
            first = v.value_references[0] - layout.offset["output"]
            if v.causality != "output":
                raise FmuError(f"{self.path}.{v.name}", f"is {v.causality}", "an output")
            parts.append(result[first : first + v.size])
        return np.concatenate(parts) if parts else np.zeros(0)

    def reset(self) -> None:
        """Go back to the start values."""
        self._c.uuv_reset(self._live())

    def terminate(self) -> None:
        """Do nothing: there is nothing to end."""

    def free(self) -> None:
        """Free the instance; a second call does nothing."""
        if self._instance:
            self._block = np.zeros(0)
            self._c.uuv_free(self._instance)
            self._instance = None

    def binding(self) -> Binding:
        """Return the addresses that the stepping loop in C calls."""
        names = {
            "DoStep": "uuv_do_step",
            "DoSteps": "uuv_do_steps",
            "UpdateOutputs": "uuv_update_outputs",
            "GetFMUState": "uuv_get_state",
            "SetFMUState": "uuv_set_state",
        }
        addresses = {
            k: ctypes.cast(getattr(self._c, v), ctypes.c_void_p).value or 0
            for k, v in names.items()
        }
        addresses["StateSize"] = int(self._c.uuv_state_size(self._live()))
        return Binding(BindingKind.NATIVE, self._live(), addresses)

    def _live(self) -> int:
        if not self._instance:
            raise FmuError(f"{self.path}: used after it was freed")
        return self._instance


class _Instance(ctypes.Structure):
    """The head of a ``uuv_instance``, as fmus/runtime/component/uuv_component.h has it."""

    _fields_ = (
        ("component", ctypes.c_void_p),
        ("b", ctypes.c_void_p),
        ("k", ctypes.c_void_p),
        ("scratch", ctypes.c_void_p),
        ("dirty", ctypes.c_int),
        ("outputs_stale", ctypes.c_int),
        ("initialized", ctypes.c_int),
    )
