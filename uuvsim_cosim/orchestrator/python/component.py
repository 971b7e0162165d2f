"""Component from a user's Python class with `inputs`, `outputs` and ``step(t, dt, u)``."""

from __future__ import annotations

import copy
import io
import pickle
from collections.abc import Mapping
from typing import Any, NoReturn, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.python.class_file import definition, described, load, place_of
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = ["PythonComponent", "load", "load_python_component", "pickled", "unpickled"]

_State = tuple[dict[str, object], dict[str, object], float]  # attributes, values, time


def load_python_component(source: str, path: str) -> PythonComponent:
    """Instantiate ``FILE.py:Class`` or ``package.module:Class`` as the component `path`."""
    return PythonComponent(load(source), path)


@final
class PythonComponent:
    """Component whose steps are computed by an object of a user's Python class.

    The class has `inputs` and `outputs`, which map names to a unit, a size, or (size, unit); a
    unit that is None or left out is that of the connected connector. It may have
    `parameters`, names to (value, unit), which become attributes of the object. Outputs before
    the first step are zeros, or what ``initialize(t)`` returns. ``step(t, dt, u)`` gets the
    inputs by name, floats or arrays, and returns all outputs by name, valid at t + dt. ``close()``,
    if there is one, is called when the component ends.
    """

    def __init__(self, cls: type, path: str) -> None:
        self.path = path
        self._class = cls
        self._time = 0.0
        self.description = described(cls, self._made)
        self._object: object = None
        self.reset()

    # ---- values ---------------------------------------------------------------------------

    def get(self, variable: Variable) -> Any:
        """Read a value; a copy."""
        value = self._values[variable.name]
        return value.copy() if isinstance(value, np.ndarray) else value

    def set(self, variable: Variable, value: object) -> None:
        """Set an input or a parameter."""
        place = f"{self.path}.{variable.name}"
        if variable.causality not in ("input", "parameter"):
            raise FmuError(place, f"is {variable.causality}", "an input or a parameter")
        try:
            self._values[variable.name] = kept = _fitted(variable, value)
        except Misfit as misfit:
            raise FmuError(f"{place}: {misfit}") from None
        if variable.causality == "parameter":
            setattr(self._object, variable.name, kept)

    # ---- life -----------------------------------------------------------------------------

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Only note the time; the class's `initialize` runs at the end of the mode."""
        self._time = start_time

    def exit_initialization_mode(self) -> None:
        """Run the class's `initialize`, if it has one."""
        if hasattr(self._object, "initialize"):
            returned = self._called("initialize", self._time)
            if returned is not None:
                self._set_outputs(returned, "initialize", complete=False)

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Run the class's `step`; raises ComponentFailed with the user's file and line."""
        self._time = current_communication_point
        u = {v.name: self.get(v) for v in self._inputs}
        returned = self._called("step", current_communication_point, step_size, u)
        self._set_outputs(returned, "step", complete=True)

    def reset(self) -> None:
        """Make a new object of the class, with its start values."""
        self._object = self._made()
        self._inputs = self.description.of("input")
        self._outputs = self.description.of("output")
        self._values: dict[str, object] = {}
        for v in self.description.variables.values():
            self._values[v.name] = copy.copy(v.start)
            if v.causality == "parameter":
                setattr(self._object, v.name, copy.copy(v.start))

    def terminate(self) -> None:
        """Nothing to end."""

    def free(self) -> None:
        """Call the object's `close`, if it has one, and drop it."""
        kept, self._object = self._object, None
        if hasattr(kept, "close"):
            kept.close()

    # ---- states ---------------------------------------------------------------------------

    def get_fmu_state(self) -> _State:
        """Copy the object's attributes and the values."""
        if not self.description.can_get_and_set_state:
            raise FmuError(f"{self.path}: objects of {self._class.__name__} cannot be copied")
        return copy.deepcopy((vars(self._object), self._values, self._time))

    def set_fmu_state(self, state: _State) -> None:
        """Restore a copy."""
        # Copied again, so that the state can be restored more than once.
        attributes, values, self._time = copy.deepcopy(state)
        vars(self._object).clear()
        vars(self._object).update(attributes)
        self._values = values

    def serialize_fmu_state(self, state: _State) -> bytes:
        """Write a copy as bytes; only numbers, text, arrays and containers can be written."""
        return pickled(state, self.path)

    def deserialize_fmu_state(self, data: bytes) -> Any:
        """Read a copy from bytes."""
        return unpickled(data, self.path)

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: object
    ) -> NoReturn:
        """Raise FmuError: a Python class has no directional derivatives."""
        raise FmuError(f"{self.path}: a Python class gives no directional derivatives")

    def binding(self) -> Binding:
        """Return the binding of a component that the stepping loop in C calls back in Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- inside ---------------------------------------------------------------------------

    def _made(self) -> object:
        return self._called("__init__")

    def _called(self, method: str, *arguments: object) -> object:
        """Call the user's code; any error, SystemExit too, becomes a failure at the user's line."""
        try:
            called = self._class if method == "__init__" else getattr(self._object, method)
            return called(*arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise ComponentFailed(
                self.path, self._time, f"{place_of(error, self._class, method)}: in {method}()"
            ) from error

    def _set_outputs(self, returned: object, method: str, *, complete: bool) -> None:
        """Set the outputs from what the user's method returned; raises ComponentFailed."""
        names = [v.name for v in self._outputs]
        expected = f"expected a dict of {', '.join(names) or 'nothing'}"
        if not isinstance(returned, Mapping):
            raise self._failed(method, f"returned {type(returned).__name__}; {expected}")
        missing = [n for n in names if n not in returned] if complete else []
        unknown = [str(n) for n in returned if n not in names]
        problems = [f"does not return {', '.join(missing)}"] if missing else []
        if unknown:
            problems.append(f"returns {', '.join(unknown)}, which outputs does not declare")
        if problems:
            raise self._failed(method, f"{' and '.join(problems)}; {expected}")
        for v in self._outputs:
            if v.name in returned:
                try:
                    self._values[v.name] = _fitted(v, returned[v.name])
                except Misfit as misfit:
                    raise self._failed(method, f"returns {v.name}: {misfit}") from None

    def _failed(self, method: str, reason: str) -> ComponentFailed:
        place = definition(self._class, method)
        return ComponentFailed(self.path, self._time, f"{place}: {method}() {reason}")


def _fitted(variable: Variable, value: object) -> object:
    """Return the value as the variable's type, copied; raises Misfit for a wrong shape or type."""
    if variable.type == "String":
        if isinstance(value, str):
            return value
        raise Misfit(f"{value!r}", "text")
    dtype = {"Boolean": bool, "Int32": np.int32}.get(variable.type, float)
    try:
        array = np.array(value, dtype)
    except (TypeError, ValueError, OverflowError):
        raise Misfit(f"{value!r}", "numbers") from None
    if array.shape != variable.shape:
        expected = f"shape {variable.shape}" if variable.shape else "one number"
        raise Misfit(f"shape {array.shape}", expected)
    return array if variable.shape else array.item()


# Classes and functions that pickles of numpy arrays, generators and standard containers name.
_ALLOWED = {
    "builtins": {"set", "frozenset", "complex", "bytearray", "range", "slice"},
    "collections": {"deque", "OrderedDict", "defaultdict", "Counter"},
    "fractions": {"Fraction"},
    "numpy": {"ndarray", "dtype"},
    "numpy._core.multiarray": {"_reconstruct", "scalar"},
    "numpy.core.multiarray": {"_reconstruct", "scalar"},
    "numpy._core.numeric": {"_frombuffer"},
    "numpy.core.numeric": {"_frombuffer"},
    "numpy.random._pickle": {"__generator_ctor", "__bit_generator_ctor"},
    "numpy.random._pcg64": {"PCG64"},
    "numpy.random._philox": {"Philox"},
    "numpy.random.bit_generator": {"SeedSequence", "__pyx_unpickle_SeedSequence"},
}


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if name not in _ALLOWED.get(module, ()):
            raise pickle.UnpicklingError(f"{module}.{name}")
        return super().find_class(module, name)


def pickled(state: object, path: str) -> bytes:
    """Turn a state into bytes; raises FmuError unless `unpickled` can read it back."""
    try:
        data = pickle.dumps(state, protocol=4)
    except Exception as error:
        raise FmuError(f"{path}: its state cannot be written ({error})") from error
    unpickled(data, path)
    return data


def unpickled(data: bytes, path: str) -> Any:
    """Turn bytes into a state; raises FmuError for anything but numbers, texts and containers."""
    try:
        return _Reader(io.BytesIO(data)).load()
    except Exception as error:
        raise FmuError(
            path,
            f"its state holds {error}",
            "numbers, text, arrays and containers of them; no other objects can be saved",
        ) from error
