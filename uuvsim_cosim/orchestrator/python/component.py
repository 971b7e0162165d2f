"""Component from a user's Python class with `inputs`, `outputs` and ``step(t, dt, u)``."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import Binding, BindingKind
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.python.class_file import definition, described, load, place_of
from uuvsim_cosim.orchestrator.python.state import pickled, unpickled
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = ["PythonComponent", "load", "load_python_component"]


def load_python_component(source: str, path: str) -> PythonComponent:
    """Instantiate ``FILE.py:Class`` or ``package.module:Class`` as the component `path`."""
    return PythonComponent(load(source), path)


@final
class PythonComponent:
    """The `Component` protocol over an object of a user's class.

    The class has `inputs` and `outputs`, which map names to a unit, a size, or (size, unit); a
    unit that is None or left out is taken from what the connector is connected to. It may have
    `parameters`, names to (value, unit), which become attributes of the object. Outputs before
    the first step are zeros, or what ``initialize(t)`` returns. ``step(t, dt, u)`` gets the
    inputs by name, floats or arrays, and returns all outputs by name, valid at t + dt.
    """

    def __init__(self, cls: type[Any], path: str) -> None:
        self.path = path
        self._class = cls
        self._time = 0.0
        self.description = described(cls, self._made)
        self._object: Any = None
        self.reset()

    # ---- values ---------------------------------------------------------------------------

    def get(self, variable: Variable) -> Any:
        """Read a value; a copy."""
        value = self._values[variable.name]
        return value.copy() if isinstance(value, np.ndarray) else value

    def set(self, variable: Variable, value: Any) -> None:
        """Set an input or a parameter."""
        place = f"{self.path}.{variable.name}"
        if variable.causality not in ("input", "parameter"):
            raise FmuError(f"{place}: is {variable.causality}; expected an input or a parameter")
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
            given = self._called("initialize", self._time)
            if given is not None:
                self._take(given, "initialize", complete=False)

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Run the class's `step`; raises ComponentFailed with the user's file and line."""
        self._time = current_communication_point
        u = {v.name: self.get(v) for v in self._inputs}
        given = self._called("step", current_communication_point, step_size, u)
        self._take(given, "step", complete=True)

    def reset(self) -> None:
        """Make a new object of the class, with its start values."""
        self._object = self._made()
        self._inputs = self.description.of("input")
        self._outputs = self.description.of("output")
        self._values: dict[str, Any] = {}
        for v in self.description.variables.values():
            self._values[v.name] = copy.copy(v.start)
            if v.causality == "parameter":
                setattr(self._object, v.name, copy.copy(v.start))

    def terminate(self) -> None:
        """Nothing to end."""

    def free(self) -> None:
        """Let the object go."""
        self._object = None

    # ---- states ---------------------------------------------------------------------------

    def get_fmu_state(self) -> Any:
        """Copy the object's attributes and the values."""
        if not self.description.can_get_and_set_state:
            raise FmuError(f"{self.path}: objects of {self._class.__name__} cannot be copied")
        return copy.deepcopy((vars(self._object), self._values, self._time))

    def set_fmu_state(self, state: Any) -> None:
        """Restore a copy."""
        attributes, values, self._time = copy.deepcopy(state)
        vars(self._object).clear()
        vars(self._object).update(attributes)
        self._values = values

    def serialize_fmu_state(self, state: Any) -> bytes:
        """Turn a copy into bytes; refuses what is neither number, text, array nor container."""
        return pickled(state, self.path)

    def deserialize_fmu_state(self, data: bytes) -> Any:
        """Turn bytes into a copy."""
        return unpickled(data, self.path)

    def directional_derivative(
        self, unknowns: list[Variable], knowns: list[Variable], seed: Any
    ) -> Any:
        """Refuse: a class has none."""
        raise FmuError(f"{self.path}: a Python class gives no directional derivatives")

    def binding(self) -> Binding:
        """Say that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- inside ---------------------------------------------------------------------------

    def _made(self) -> Any:
        return self._guarded("__init__", self._class)

    def _called(self, method: str, *arguments: Any) -> Any:
        return self._guarded(method, getattr(self._object, method), *arguments)

    def _guarded(self, method: str, call: Callable[..., Any], *arguments: Any) -> Any:
        """Call the user's code; whatever it raises, SystemExit too, is a failure of its line."""
        try:
            return call(*arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise ComponentFailed(
                self.path, self._time, f"{place_of(error, self._class, method)}: in {method}()"
            ) from error

    def _take(self, given: Any, method: str, *, complete: bool) -> None:
        names = [v.name for v in self._outputs]
        if not isinstance(given, Mapping):
            raise self._wrong(method, f"returned {type(given).__name__}", names)
        missing = [n for n in names if n not in given] if complete else []
        unknown = [str(n) for n in given if n not in names]
        if missing or unknown:
            problems = [f"gives no {', '.join(missing)}"] if missing else []
            problems += (
                [f"gives {', '.join(unknown)}, which outputs does not name"] if unknown else []
            )
            raise self._wrong(method, " and ".join(problems), names)
        for v in self._outputs:
            if v.name in given:
                try:
                    self._values[v.name] = _fitted(v, given[v.name])
                except Misfit as misfit:
                    raise self._failed(method, f"gives {v.name}: {misfit}") from None

    def _wrong(self, method: str, read: str, names: list[str]) -> ComponentFailed:
        return self._failed(method, f"{read}; expected a dict of {', '.join(names) or 'nothing'}")

    def _failed(self, method: str, what: str) -> ComponentFailed:
        place = definition(self._class, method)
        return ComponentFailed(self.path, self._time, f"{place}: {method}() {what}")


def _fitted(variable: Variable, value: Any) -> Any:
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
