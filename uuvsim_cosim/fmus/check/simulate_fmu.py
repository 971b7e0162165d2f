"""Simulation of one FMU from start to end, with given inputs and recorded outputs."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, final

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError
from uuvsim_cosim.fmus.check.row_sinks import ColumnRows, CsvRows, Rows, check_room
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.importer.input_csv import (
    Series,
    apply_series,
    find_element,
    read_input_csv,
    series_of,
)
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu
from uuvsim_cosim.fmus.isolation.guard import AtComponentExit
from uuvsim_cosim.fmus.tracing.trace import Trace, instantiate_traced
from uuvsim_cosim.fmus.values import checked_start, parse_value
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = [
    "SimulationFile",
    "SimulationInterrupted",
    "SimulationResult",
    "simulate_fmu",
    "simulate_fmu_to_csv",
]

Inputs = Mapping[str, object] | Path | str | None
_DEFAULT_STEP, _DEFAULT_SPAN = 0.01, 10.0  # [s] if the FMU has none
# A default experiment without a step size gets `_FEW` steps if `_DEFAULT_STEP` made over `_MANY`.
_MANY, _FEW = 100_000, 1000


@dataclass(frozen=True)
class SimulationResult:
    """Values at the communication points; ``result["x"]`` has shape (points, *shape of x).

    `notes` report automatic choices, such as a step or a solver.
    """

    time: np.ndarray
    columns: Mapping[str, np.ndarray]
    variables: Mapping[str, Variable]
    messages: Sequence[tuple[str, str]] = field(default_factory=list)
    asked_to_end: bool = False  # before `until`
    notes: Sequence[str] = ()

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a variable over time."""
        return self.columns[name]

    def write_csv(self, path: Path) -> None:
        """Write the time and one column for each element, to the last bit; all or nothing."""
        try:
            with whole_file(path) as scratch:
                rows = CsvRows(scratch, list(self.variables.values()), path)
                for k, t in enumerate(self.time.tolist()):
                    rows.add(t, [self.columns[n][k] for n in self.variables])
                rows.close()
        except OSError as error:
            raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None


@dataclass(frozen=True)
class SimulationFile:
    """A simulation's CSV file: `rows` lines, from `begin` to `end` [s]."""

    path: Path
    rows: int
    outputs: int
    begin: float
    end: float
    messages: Sequence[tuple[str, str]] = field(default_factory=list)
    asked_to_end: bool = False  # before `until`
    notes: Sequence[str] = ()


class SimulationInterrupted(KeyboardInterrupt):
    """Ctrl-C in a simulation into a file; `partial` describes the file."""

    def __init__(self, partial: SimulationFile) -> None:
        super().__init__()
        self.partial = partial


def simulate_fmu(
    fmu: Path | str | FmuArchive,
    *,
    until: float | None = None,
    step: float | str | Fraction | None = None,
    inputs: Inputs = None,
    start: Mapping[str, Any] | None = None,
    outputs: Sequence[str] | None = None,
    trace: Trace | None = None,
    start_time: float | None = None,
    interface: str | None = None,
) -> SimulationResult:
    """Simulate an `fmu` from `start_time` to `until` [s], communicating every `step` [s].

    Without `start_time`, from the start of its default experiment, else 0; without `until`, to
    that experiment's end, else for 10 s; less if the FMU asks to end. Without `step`, with the step
    of that experiment, else 0.01 s, or a longer one over a long time; the result notes it.
    `inputs` is a CSV file (first column: time), or a mapping: of constants and functions of
    time by name, or, with a key ``time``, of samples. Continuous inputs are interpolated, others
    held, at the communication points. `start` values may be text, as a user types them; structural
    parameters among them set the shapes of arrays. `outputs` are names of what is recorded, all
    outputs by default. Each call of the FMU goes into `trace`. `interface` is CoSimulation or
    ModelExchange, for an FMU that offers both (default: CoSimulation).

    Raises InputInvalid or FmuError before anything runs, ComponentFailed while it runs. The
    attribute `partial` of that error, a SimulationResult, has the values up to then.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.fmus import build_fmu, simulate_fmu
    >>> fmu = build_fmu(uuv.declare("battery"))
    >>> result = simulate_fmu(fmu, until=60.0, step=1.0, inputs={"current": 10.0})  # [A]
    >>> result.time.shape, f"{result['voltage'][-1]:.2f} V"
    ((61,), '16.46 V')
    """
    run = _Simulation(fmu, until, step, inputs, start, outputs, start_time, interface)
    rows = ColumnRows(run.recorded)

    def result() -> SimulationResult:
        return SimulationResult(
            rows.time, rows.columns, {v.name: v for v in run.recorded}, run.messages,
            run.asked_to_end, run.notes,
        )  # fmt: skip

    try:
        run.into(rows, trace)
    except ComponentFailed as error:
        if rows.count:
            error.partial = result()
        raise
    return result()


def simulate_fmu_to_csv(
    fmu: Path | str | FmuArchive,
    target: Path,
    *,
    until: float | None = None,
    step: float | str | Fraction | None = None,
    inputs: Inputs = None,
    start: Mapping[str, object] | None = None,
    outputs: Sequence[str] | None = None,
    trace: Trace | None = None,
    start_time: float | None = None,
    interface: str | None = None,
    instantiate: Callable[[FmuArchive, str], Component] | None = None,
) -> SimulationFile:
    """Simulate an FMU as `simulate_fmu` does, and write each row into a CSV file as it comes.

    Memory does not grow with the number of rows. The file is begun after initialization, and
    holds all rows up to then if the simulation fails or is interrupted. `instantiate` makes the
    component, by the FMU and its name, in place of `instantiate_fmu`. Raises InputInvalid before
    anything runs if the disk has not enough room, RecordingError if it becomes full,
    SimulationInterrupted on Ctrl-C.
    """
    run = _Simulation(fmu, until, step, inputs, start, outputs, start_time, interface)
    check_room(target, run.count + 1, run.recorded)

    def result() -> SimulationFile:
        return SimulationFile(
            target, rows.count, len(run.recorded), float(run.begin), rows.last_time, run.messages,
            run.asked_to_end, run.notes,
        )  # fmt: skip

    def ended() -> None:
        rows.close()
        if rows.count:
            sys.stderr.write(f"uuvsim: the values up to that time are in {target}\n")

    with CsvRows(target, run.recorded) as rows, AtComponentExit(ended):
        try:
            run.into(rows, trace, instantiate)
        except ComponentFailed as error:
            if rows.count:
                error.partial = result()
            raise
        except KeyboardInterrupt:
            if rows.count:
                raise SimulationInterrupted(result()) from None
            raise
    return result()


@final
class _Simulation:
    """A simulation that runs once; communication points are ``begin + k tick`` [s], k ≤ `count`.

    `notes` report automatic choices, before and during the run.
    """

    def __init__(
        self, fmu: Path | str | FmuArchive, until: float | None,
        step: float | str | Fraction | None, inputs: Inputs, start: Mapping[str, object] | None,
        outputs: Sequence[str] | None, start_time: float | None, interface: str | None,
    ) -> None:  # fmt: skip
        archive = fmu if isinstance(fmu, FmuArchive) else read_fmu(Path(fmu), interface)
        values = dict(start or {})
        variables = archive.description.variables
        structure = {
            name: values.pop(name)
            for name in list(values)
            if name in variables and variables[name].causality == "structuralParameter"
        }
        if structure or interface not in (None, archive.interface):
            interface = interface or archive.interface
            archive = read_fmu(archive.path, interface, {**archive.structure, **structure})
        self.archive = archive
        self.messages: list[tuple[str, str]] = []
        self.asked_to_end = False
        self.notes: tuple[str, ...] = ()
        self._set_times(until, step, start_time)
        description = archive.description
        self._given: list[tuple[Variable, object]] = []  # inputs that are constants or functions
        self._series: list[Series] = []
        if isinstance(inputs, (str, Path)):
            self._series = read_input_csv(Path(inputs), description)
        elif inputs is not None and "time" in inputs:
            self._series = series_of(inputs, description)
        else:
            known = {v.name: v for v in description.of("input")}
            for name, value in (inputs or {}).items():
                if name not in known:
                    expected = expected_names(name, known)
                    raise InputInvalid("inputs", f"unknown name {name!r}", expected)
                if not callable(value):
                    value = checked_start(known[name], value, f"inputs: {name}")
                self._given.append((known[name], value))
        self._start = _start_values(values, archive)
        recorded = description.of("output")
        for name in outputs or ():
            if name not in description.variables:
                expected = expected_names(name, [v.name for v in recorded])
                raise InputInvalid("outputs", f"unknown name {name!r}", expected)
        if outputs is not None:
            recorded = [description.variables[name] for name in dict.fromkeys(outputs)]
        self.recorded = recorded

    def _set_times(
        self, until: float | None, step: float | str | Fraction | None, start_time: float | None
    ) -> None:
        """Set begin, step and number of steps; an end that is not given is at a whole step."""
        fmu = self.archive
        if start_time is None:
            default = fmu.default_start_time
            start_time = default if default is not None and math.isfinite(default) else 0.0
        try:
            begin = Fraction(str(start_time))
        except (ValueError, ZeroDivisionError):
            raise InputInvalid(f"start time = {start_time}", "seconds") from None
        free_end = until is None
        if until is None:
            stop = fmu.default_stop_time
            given = stop is not None and float(begin) < stop < math.inf
            until = stop if stop is not None and given else float(begin) + _DEFAULT_SPAN
        try:
            end = Fraction(str(until))
            tick = Fraction(str(step)) if step is not None else None
        except (ValueError, ZeroDivisionError):
            raise InputInvalid(f"until = {until}, step = {step}", "seconds") from None
        size = fmu.description.default_step_size
        if size is None or not 0 < size < math.inf:
            size = _DEFAULT_STEP
            span = until - float(begin)
            if free_end and tick is None and span > _MANY * _DEFAULT_STEP:
                size = span / _FEW
                self.notes = (
                    f"the FMU states no step for its experiment of {span:g} s: "
                    f"{size:g} s was chosen",
                )
        if free_end and tick is not None and tick > 0:
            until = float(begin + math.ceil((end - begin) / tick) * tick)
            end = Fraction(str(until))
        if end <= begin and begin:
            raise InputInvalid(
                f"until = {until} s, but the start is {float(begin):g} s",
                "a later end, or another start time",
            )
        if end <= begin or (tick is not None and tick <= 0):
            raise InputInvalid(f"until = {until} s, step = {step} s", "more than 0")
        if tick is None:
            count = math.ceil((end - begin) / Fraction(str(size)))
            tick = (end - begin) / count
        else:
            count, rest = divmod(end - begin, tick)
            if rest:
                low, high = float(begin + count * tick), float(begin + (count + 1) * tick)
                after = f" after {float(begin):g} s" if begin else ""
                raise InputInvalid(
                    f"until = {until} s is not a whole multiple of step = {step} s{after}",
                    f"{low:g} s or {high:g} s",
                )
        self.begin, self.tick, self.count = begin, tick, int(count)

    def into(
        self,
        rows: Rows,
        trace: Trace | None,
        instantiate: Callable[[FmuArchive, str], Component] | None = None,
    ) -> None:
        """Simulate, and add the values of each communication point to the rows."""
        name = self.archive.description.name
        if trace is None:
            component = (instantiate or instantiate_fmu)(self.archive, name)
        else:
            component = instantiate_traced(self.archive, name, trace)
        # Each point is rounded once, so that errors do not add up.
        points = (float(self.begin + k * self.tick) for k in range(self.count + 1))
        try:
            for variable, value in self._start:
                component.set(variable, value)
            t = next(points)
            end = float(self.begin + self.count * self.tick)
            component.enter_initialization_mode(t, end)
            self._set_inputs(component, t)
            component.exit_initialization_mode()
            rows.add(t, _values(component, self.recorded, t))
            for after in points:
                self._set_inputs(component, t)
                component.do_step(t, float(self.tick))
                t = after
                rows.add(t, _values(component, self.recorded, t))
            component.terminate()
        except ComponentFailed as error:
            if not (rows.count and error.asks_to_end):
                raise
            self.asked_to_end = True
            if error.time > rows.last_time:
                with suppress(UuvsimError):  # FMI does not require values in this state
                    rows.add(error.time, _values(component, self.recorded, error.time))
        finally:
            self.messages = list(getattr(component, "messages", []))
            self.notes += tuple(getattr(component, "lacking", ()))
            self.notes += tuple(text for level, text in self.messages if level == "note")
            component.free()

    def _set_inputs(self, component: Component, t: float) -> None:
        for variable, value in self._given:
            component.set(variable, value(t) if callable(value) else value)
        apply_series(component, self._series, t)


def _values(component: Component, variables: Sequence[Variable], t: float) -> list[np.ndarray]:
    values = []
    for variable in variables:
        value = np.asarray(component.get(variable), dtype=DTYPES[variable.type])
        if value.dtype.kind == "f" and not np.all(np.isfinite(value)):
            raise ComponentFailed(component.path, t, f"{variable.name} is not finite: {value}")
        values.append(value)
    return values


def _start_values(
    start: Mapping[str, object], archive: FmuArchive
) -> list[tuple[Variable, object]]:
    """Return start values by variable; elements of an array are combined with its own start."""
    variables = archive.description.variables
    settable = [
        v
        for v in variables.values()
        if v.variability != "constant" and (v.causality in ("input", "parameter") or v.initial)
    ]
    whole: dict[str, np.ndarray] = {}
    for name, value in start.items():
        place = f"start value {name}"
        if name in variables:
            variable = variables[name]
            if variable.variability == "constant":
                raise InputInvalid(place, "is a constant", "a parameter or an input")
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
