"""Simulation of one FMU from start to end, with given inputs and recorded outputs."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
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
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.importer.input_csv import (
    Series,
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
    """Simulate an FMU from `start_time` to `until` [s], communicating every `step` [s].

    Without `start_time`, from the start of its default experiment, else 0; without `until`, to
    that experiment's end, else for 10 s; less if the FMU asks to end.
    `inputs` is a CSV file (first column: time), or a mapping: of constants and functions of
    time by name, or, with a key ``time``, of samples. Continuous inputs are interpolated, others
    held, at the communication points. `start` values may be text, as a user types them; structural
    parameters among them set the shapes of arrays. `outputs` are names of what is recorded, all
    outputs by default. Each call of the FMU goes into `trace`. `interface` is CoSimulation or
    ModelExchange, for an FMU that offers both (default: CoSimulation).

    Raises InputInvalid or FmuError before anything runs, ComponentFailed while it runs; the
    values up to then are its attribute `partial`, a SimulationResult.
    """
    plan = _plan(fmu, until, step, inputs, start, outputs, start_time, interface)
    rows = ColumnRows(plan.recorded)
    run = _Run(plan)

    def result() -> SimulationResult:
        return SimulationResult(
            rows.time, rows.columns, {v.name: v for v in plan.recorded}, run.messages,
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
) -> SimulationFile:
    """Simulate an FMU as `simulate_fmu` does, and write each row into a CSV file as it comes.

    Memory does not grow with the number of rows. The file is begun after initialization, and
    holds all rows up to then if the simulation fails or is interrupted. Raises InputInvalid
    before anything runs if the disk has not enough room, RecordingError if it becomes full,
    SimulationInterrupted on Ctrl-C.
    """
    plan = _plan(fmu, until, step, inputs, start, outputs, start_time, interface)
    check_room(target, plan.count + 1, plan.recorded)
    run = _Run(plan)

    def ended() -> None:
        rows.close()
        if rows.count:
            sys.stderr.write(f"uuvsim: the values up to then are in {target}\n")

    with CsvRows(target, plan.recorded) as rows, AtComponentExit(ended):
        try:
            run.into(rows, trace)
        except ComponentFailed as error:
            if rows.count:
                error.partial = _file(target, plan, rows, run)
            raise
        except KeyboardInterrupt:
            if rows.count:
                raise SimulationInterrupted(_file(target, plan, rows, run)) from None
            raise
    return _file(target, plan, rows, run)


def _file(target: Path, plan: _Plan, rows: CsvRows, run: _Run) -> SimulationFile:
    return SimulationFile(
        target, rows.count, len(plan.recorded), float(plan.begin), rows.last_time, run.messages,
        run.asked_to_end, run.notes,
    )  # fmt: skip


@dataclass(frozen=True)
class _Plan:
    """A simulation to be run: communication points are ``begin + k tick`` [s], k = 0 … `count`."""

    archive: FmuArchive
    begin: Fraction
    tick: Fraction
    count: int
    feed: _Feed
    start: Sequence[tuple[Variable, object]]
    recorded: Sequence[Variable]
    notes: tuple[str, ...]

    def time(self, k: int) -> float:
        """Return communication point k [s]: rounded once, so that errors do not add up."""
        return float(self.begin + k * self.tick)


def _plan(
    fmu: Path | str | FmuArchive, until: float | None, step: float | str | Fraction | None,
    inputs: Inputs, start: Mapping[str, object] | None, outputs: Sequence[str] | None,
    start_time: float | None, interface: str | None,
) -> _Plan:  # fmt: skip
    archive, values = _archive(fmu, interface, start or {})
    description = archive.description
    if start_time is None:
        default = archive.default_start_time
        start_time = default if default is not None and math.isfinite(default) else 0.0
    try:
        begin = Fraction(str(start_time))
    except (ValueError, ZeroDivisionError):
        raise InputInvalid(f"start time = {start_time}", "seconds") from None
    notes: list[str] = []
    size = description.default_step_size
    if until is None:
        until, longer = _default_end(archive, begin, step)
        if longer is not None:
            size = longer
            notes.append(
                f"the FMU gives no step for its experiment of {until - float(begin):g} s: "
                f"{longer:g} s was chosen"
            )
    tick, count = _steps(begin, until, step, size)
    return _Plan(
        archive, begin, tick, count, _feed(inputs, description), _start_values(values, archive),
        _recorded(outputs, description), tuple(notes),
    )  # fmt: skip


def _archive(
    fmu: Path | str | FmuArchive, interface: str | None, start: Mapping[str, object]
) -> tuple[FmuArchive, dict[str, object]]:
    """Read the FMU with its structural parameters; return it and the other start values."""
    archive = fmu if isinstance(fmu, FmuArchive) else read_fmu(Path(fmu), interface)
    variables = archive.description.variables
    structure = {
        name: value
        for name, value in start.items()
        if name in variables and variables[name].causality == "structuralParameter"
    }
    if structure or interface not in (None, archive.interface):
        archive = read_fmu(
            archive.path, interface or archive.interface, {**archive.structure, **structure}
        )
    return archive, {name: value for name, value in start.items() if name not in structure}


@final
class _Run:
    """One simulation of a plan, with its messages."""

    def __init__(self, plan: _Plan) -> None:
        self._plan = plan
        self.messages: list[tuple[str, str]] = []
        self.asked_to_end = False

    @property
    def notes(self) -> tuple[str, ...]:
        """Automatic choices, before and during the simulation."""
        return (*self._plan.notes, *(text for level, text in self.messages if level == "note"))

    def into(self, rows: Rows, trace: Trace | None) -> None:
        """Simulate, and add the values of each communication point to the rows."""
        plan, name = self._plan, self._plan.archive.description.name
        if trace is None:
            component = instantiate_fmu(plan.archive, name)
        else:
            component = instantiate_traced(plan.archive, name, trace)
        try:
            for t in self._points(component):
                rows.add(t, _values(component, plan.recorded, t))
        except ComponentFailed as error:
            if not (rows.count and error.asks_to_end):
                raise
            self.asked_to_end = True
            if error.time > rows.last_time:
                with suppress(UuvsimError):  # FMI does not require values in this state
                    rows.add(error.time, _values(component, plan.recorded, error.time))
        finally:
            self.messages = list(getattr(component, "messages", []))
            component.free()

    def _points(self, component: Component) -> Iterator[float]:
        """Run the component; yield each communication point when its values are valid."""
        plan = self._plan
        for variable, value in plan.start:
            component.set(variable, value)
        t = plan.time(0)
        component.enter_initialization_mode(t, plan.time(plan.count))
        plan.feed.apply(component, t)
        component.exit_initialization_mode()
        yield t
        for k in range(plan.count):
            plan.feed.apply(component, t)
            component.do_step(t, float(plan.tick))
            t = plan.time(k + 1)
            yield t
        component.terminate()


def _values(component: Component, variables: Sequence[Variable], t: float) -> list[np.ndarray]:
    values = []
    for variable in variables:
        value = np.asarray(component.get(variable), dtype=DTYPES[variable.type])
        if value.dtype.kind == "f" and not np.all(np.isfinite(value)):
            raise ComponentFailed(component.path, t, f"{variable.name} is not finite: {value}")
        values.append(value)
    return values


def _default_end(
    fmu: FmuArchive, begin: Fraction, step: float | str | Fraction | None
) -> tuple[float, float | None]:
    """Return the end of an FMU's default experiment, at a whole step if the user gives a step.

    The second value is the step of a long experiment whose FMU has none, else None.
    """
    end = fmu.default_stop_time
    if end is None or not float(begin) < end < math.inf:
        end = float(begin) + _DEFAULT_SPAN
    try:
        h = Fraction(str(step)) if step is not None else Fraction()
    except (ValueError, ZeroDivisionError):
        return end, None  # `_steps` refuses this step
    if h > 0:
        return float(begin + math.ceil((Fraction(str(end)) - begin) / h) * h), None
    span = end - float(begin)
    given = step is not None or _is_step(fmu.description.default_step_size)
    return end, None if given or span <= _MANY * _DEFAULT_STEP else span / _FEW


def _is_step(size: float | None) -> bool:
    return size is not None and math.isfinite(size) and size > 0


def _steps(
    begin: Fraction, until: float, step: float | str | Fraction | None, default: float | None
) -> tuple[Fraction, int]:
    """Return the step and the number of steps from `begin` to `until` [s]."""
    try:
        end = Fraction(str(until))
        tick = Fraction(str(step)) if step is not None else None
    except (ValueError, ZeroDivisionError):
        raise InputInvalid(f"until = {until}, step = {step}", "seconds") from None
    if end <= begin and begin:
        raise InputInvalid(
            f"until = {until} s, but the start is {float(begin):g} s",
            "a later end, or another start time",
        )
    if end <= begin or (tick is not None and tick <= 0):
        raise InputInvalid(f"until = {until} s, step = {step} s", "more than 0")
    span = end - begin
    if tick is None:
        wanted = Fraction(str(default if _is_step(default) else _DEFAULT_STEP))
        count = math.ceil(span / wanted)
        return span / count, count
    count, rest = divmod(span, tick)
    if rest:
        low, high = float(begin + count * tick), float(begin + (count + 1) * tick)
        after = f" after {float(begin):g} s" if begin else ""
        raise InputInvalid(
            f"until = {until} s is not a whole multiple of step = {step} s{after}",
            f"{low:g} s or {high:g} s",
        )
    return tick, int(count)


@final
class _Feed:
    """The inputs at each communication point: constants, functions and series."""

    def __init__(self) -> None:
        self.given: dict[str, tuple[Variable, object]] = {}
        self.series: dict[str, list[Series]] = {}

    def apply(self, component: Component, t: float) -> None:
        """Set the inputs; elements of an array without a series keep their values."""
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
                expected = expected_names(name, known)
                raise InputInvalid("inputs", f"unknown name {name!r}", expected)
            if not callable(value):
                value = checked_start(known[name], value, f"inputs: {name}")
            feed.given[name] = (known[name], value)
    for one in series:
        feed.series.setdefault(one.variable.name, []).append(one)
    return feed


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


def _recorded(outputs: Sequence[str] | None, description: Description) -> list[Variable]:
    if outputs is None:
        return description.of("output")
    for name in outputs:
        if name not in description.variables:
            names = [v.name for v in description.of("output")]
            raise InputInvalid("outputs", f"unknown name {name!r}", expected_names(name, names))
    return [description.variables[name] for name in dict.fromkeys(outputs)]
