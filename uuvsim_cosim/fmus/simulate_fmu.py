"""One FMU, alone, from start to end: inputs over time in, outputs over time out."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.input_csv import (
    Series,
    element_names,
    find_element,
    read_input_csv,
    series_of,
    suggestion,
)
from uuvsim_cosim.fmus.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.values import checked_start, parse_value

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.trace import Trace

__all__ = ["SimulationResult", "simulate_fmu"]

Inputs = Mapping[str, Any] | Path | str | None
_DEFAULT_STEP, _DEFAULT_END = 0.01, 10.0  # s, where an FMU gives none


@dataclass(frozen=True)
class SimulationResult:
    """Values at the communication points; ``result["x"]`` has shape (points, *shape of x)."""

    time: np.ndarray
    columns: Mapping[str, np.ndarray]
    variables: Mapping[str, Variable]
    messages: Sequence[tuple[str, str]] = field(default_factory=list)
    asked_to_end: bool = False  # before `until`

    def __getitem__(self, name: str) -> np.ndarray:
        """Give a variable over time."""
        return self.columns[name]

    def write_csv(self, path: Path) -> None:
        """Write the time and one column for each element, to the last bit; all or nothing."""
        names = [n for v in self.variables.values() for n in element_names(v)]
        tables = [self.columns[n].reshape(self.time.size, -1) for n in self.variables]
        scratch = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            with scratch.open("w", newline="", encoding="utf-8") as sink:
                writer = csv.writer(sink)
                writer.writerow(["time", *names])
                for k, t in enumerate(self.time.tolist()):
                    writer.writerow([repr(t), *(_text(x) for a in tables for x in a[k].tolist())])
            os.replace(scratch, path)
        except OSError as error:
            scratch.unlink(missing_ok=True)
            raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None


def simulate_fmu(
    fmu: Path | str | FmuArchive,
    *,
    until: float | None = None,
    step: float | str | Fraction | None = None,
    inputs: Inputs = None,
    start: Mapping[str, Any] | None = None,
    outputs: Sequence[str] | None = None,
    trace: Trace | None = None,
) -> SimulationResult:
    """Simulate an FMU from 0 to `until` [s], communicating at every whole multiple of `step` [s].

    Without `until`, to the end of its default experiment, else 10 s; less if it asks to end.
    `inputs` is a CSV file (first column: time), or a mapping: of constants and functions of
    time by name, or, with a key ``time``, of samples. Continuous inputs are interpolated, others
    held, at the communication points. `start` values may be text, as a user types them.
    `outputs` are names of what is recorded, all outputs by default. Each call of the FMU goes
    into `trace`.

    Raises InputInvalid or FmuError before anything runs, ComponentFailed while it runs; the
    values up to then are its attribute `partial`, a SimulationResult.
    """
    archive = fmu if isinstance(fmu, FmuArchive) else read_fmu(Path(fmu))
    description = archive.description
    if until is None:
        until = _default_end(archive, step)
    tick, count = _steps(until, step, description.default_step_size)
    feed = _feed(inputs, description)
    begin = _start_values(start or {}, archive)
    recorded = _recorded(outputs, description)
    component = _instance(archive, trace)
    samples = _Samples(recorded, count + 1)
    try:
        for variable, value in begin:
            component.set(variable, value)
        component.enter_initialization_mode(0.0, float(tick * count))
        feed.apply(component, 0.0)
        component.exit_initialization_mode()
        samples.take(component, 0, 0.0)
        for k in range(count):
            t, t_next = float(k * tick), float((k + 1) * tick)
            feed.apply(component, t)
            component.do_step(t, float(tick))
            samples.take(component, k + 1, t_next)
        component.terminate()
        return samples.result(component, tick)
    except ComponentFailed as error:
        if samples.taken and error.asks_to_end:
            return replace(samples.result(component, tick), asked_to_end=True)
        if samples.taken:
            error.partial = samples.result(component, tick)
        raise
    finally:
        component.free()


def _instance(archive: FmuArchive, trace: Trace | None) -> Component:
    if trace is None:
        return instantiate_fmu(archive, archive.description.name)
    from uuvsim_cosim.fmus.trace import instantiate_traced

    return instantiate_traced(archive, archive.description.name, trace)


def _default_end(fmu: FmuArchive, step: float | str | Fraction | None) -> float:
    """Give the end of an FMU's default experiment, at a whole step where a user gives one."""
    end = fmu.default_stop_time
    if end is None or not 0.0 < end < math.inf:
        end = _DEFAULT_END
    try:
        h = Fraction(str(step)) if step is not None else Fraction()
    except (ValueError, ZeroDivisionError):
        return end  # said with the step
    return float(math.ceil(Fraction(str(end)) / h) * h) if h > 0 else end


def _steps(
    until: float, step: float | str | Fraction | None, default: float | None
) -> tuple[Fraction, int]:
    try:
        end = Fraction(str(until))
        tick = Fraction(str(step)) if step is not None else None
    except (ValueError, ZeroDivisionError):
        raise InputInvalid(f"until = {until}, step = {step}; expected seconds") from None
    if end <= 0 or (tick is not None and tick <= 0):
        raise InputInvalid(f"until = {until} s, step = {step} s; expected more than 0")
    if tick is None:
        usable = default is not None and math.isfinite(default) and default > 0
        wanted = Fraction(str(default if usable else _DEFAULT_STEP))
        count = math.ceil(end / wanted)
        return end / count, count
    count, rest = divmod(end, tick)
    if rest:
        raise InputInvalid(
            f"until = {until} s is not a whole multiple of step = {step} s; "
            f"expected {float(count * tick):g} s or {float((count + 1) * tick):g} s"
        )
    return tick, int(count)


@final
class _Feed:
    """What is set at each communication point: constants, functions and series."""

    def __init__(self) -> None:
        self.given: dict[str, tuple[Variable, Any]] = {}
        self.series: dict[str, list[Series]] = {}

    def apply(self, component: Component, t: float) -> None:
        for variable, value in self.given.values():
            component.set(variable, value(t) if callable(value) else value)
        for group in self.series.values():
            variable = group[0].variable
            if not variable.shape:
                component.set(variable, group[0].at(t))
                continue
            partial = len(group) < variable.size
            flat = (
                np.asarray(component.get(variable)).ravel()
                if partial
                else np.empty(variable.size, dtype=DTYPES[variable.type])
            )
            for series in group:
                flat[series.element] = series.at(t)
            component.set(variable, flat.reshape(variable.shape))


def _feed(inputs: Inputs, description: Description) -> _Feed:
    feed = _Feed()
    series: list[Series] = []
    if isinstance(inputs, (str, Path)):
        series = read_input_csv(Path(inputs), description)
    elif inputs is not None and "time" in inputs:
        series = series_of(inputs, description)
    else:
        known = {v.name: v for v in description.of("input")}
        for name, value in (inputs or {}).items():
            if name not in known:
                raise InputInvalid(
                    f"inputs: unknown name {name!r}; {suggestion(name, list(known))}"
                )
            if not callable(value):
                value = checked_start(known[name], value, f"inputs: {name}")
            feed.given[name] = (known[name], value)
    for each in series:
        feed.series.setdefault(each.variable.name, []).append(each)
    return feed


def _start_values(start: Mapping[str, Any], archive: FmuArchive) -> list[tuple[Variable, Any]]:
    variables = archive.description.variables
    settable = [
        v
        for v in variables.values()
        if v.variability != "constant" and (v.causality in ("input", "parameter") or v.initial)
    ]
    whole: dict[str, Any] = {}
    for name, value in start.items():
        place = f"start value {name}"
        if name in variables:
            variable = variables[name]
            if variable.variability == "constant":
                raise InputInvalid(f"{place}: is a constant; expected a parameter or an input")
            if isinstance(value, str):
                items = archive.enumerations.get(name)
                value = parse_value(variable, value, place, items)
            whole[name] = checked_start(variable, value, place)
            continue
        variable, element = find_element(settable, name, "start values")
        if variable.name not in whole:
            if variable.start is None:
                raise InputInvalid(f"{place}: expected all of {variable.name}, which has no start")
            whole[variable.name] = np.array(variable.start)
        scalar = Variable(**{**variable.__dict__, "shape": ()})
        value = parse_value(scalar, value, place) if isinstance(value, str) else value
        whole[variable.name].flat[element] = checked_start(scalar, value, place)
    return [(variables[name], value) for name, value in whole.items()]


def _recorded(outputs: Sequence[str] | None, description: Description) -> list[Variable]:
    if outputs is None:
        return description.of("output")
    for name in outputs:
        if name not in description.variables:
            names = [v.name for v in description.of("output")]
            raise InputInvalid(f"outputs: unknown name {name!r}; {suggestion(name, names)}")
    return [description.variables[name] for name in dict.fromkeys(outputs)]


@final
class _Samples:
    """The recorded values, filled one communication point at a time."""

    def __init__(self, variables: Sequence[Variable], points: int) -> None:
        self._variables = variables
        self._points = points
        self.columns: dict[str, np.ndarray] = {}
        self.taken = 0

    def result(self, component: Component, tick: Fraction) -> SimulationResult:
        time = np.array([float(k * tick) for k in range(self.taken)])
        columns = {name: column[: self.taken] for name, column in self.columns.items()}
        messages = list(getattr(component, "messages", []))
        return SimulationResult(time, columns, {v.name: v for v in self._variables}, messages)

    def take(self, component: Component, k: int, t: float) -> None:
        for variable in self._variables:
            value = np.asarray(component.get(variable), dtype=_dtype(variable))
            if value.dtype.kind == "f" and not np.all(np.isfinite(value)):
                raise ComponentFailed(component.path, t, f"{variable.name} is not finite: {value}")
            if variable.name not in self.columns:
                shape = (self._points, *variable.shape)
                self.columns[variable.name] = np.empty(shape, dtype=value.dtype)
            self.columns[variable.name][k] = value
        self.taken = k + 1


def _dtype(variable: Variable) -> Any:
    return object if variable.type in ("String", "Binary") else None


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, np.ndarray):  # a string or binary scalar in a column of objects
        return _text(value.item())
    return value if isinstance(value, str) else repr(value)
