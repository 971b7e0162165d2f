"""Inputs of a system over time: unconnected inputs are set, and signals get a value added.

Values are sampled at the communication points. An unconnected input holds the value of a point
during the step that begins there; a value added to a signal is seen at that point by all readers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.importer.input_csv import read_input_csv
from uuvsim_cosim.fmus.values import range_text
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.real_time import Steps
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.scenarios.played import SteppedMaster, events_of
from uuvsim_cosim.orchestrator.scenarios.scenario import Manipulation, SignalFault
from uuvsim_cosim.orchestrator.scenarios.waveforms import Waveform, waveform
from uuvsim_cosim.orchestrator.values.endpoints import resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion, fit

__all__ = ["Drive", "Driven", "held_by", "read_inputs", "start_values"]

_EXPECTED = "FILE.csv, or [+]component.variable:step|chirp|prbs,…"


@dataclass(frozen=True)
class Drive:
    """One element of a variable over time: `of` returns its value, in its unit, at a time [s].

    `added`: the value is added to the start value of an unconnected input, or to a signal. `note`
    is for the report of the run: source, unit, and the value between samples.
    """

    component: str
    variable: Variable
    element: int
    added: bool
    of: Callable[[float], float]
    note: str

    @property
    def name(self) -> str:
        """Name as a user writes it, such as ``+a.x[1]``."""
        return f"{'+' * self.added}{self.component}.{self.variable.element_name(self.element)}"


def read_inputs(texts: Sequence[str], plan: Plan) -> tuple[Drive, ...]:
    """Read inputs for a system: CSV files, and waveforms such as ``+a.x[1]:step,value=1``.

    The columns of a file are ``time`` [s] and such names. Raises InputInvalid for a text that
    cannot be read, and for a variable that does not exist, is connected but has no "+", or is
    given twice, and for a value of an unconnected input that is outside of its [min, max].
    """
    connected = _connected(plan)
    found: list[Drive] = []
    for text in texts:
        if Path(text).suffix.lower() == ".csv":
            found += _of_file(Path(text), plan)
        elif ":" in text:
            found += _of_waveform(text, plan)
        else:
            raise InputInvalid(f"--input {text}: expected {_EXPECTED}")
    seen: set[tuple[str, str, int, bool]] = set()
    noted: list[Drive] = []
    for d in found:
        key = (d.component, d.variable.name, d.element, d.added)
        if key in seen:
            raise InputInvalid(f"--input {d.name}: is given twice", "once")
        seen.add(key)
        place = (d.component, d.variable.name, d.element)
        if d.variable.causality == "input" and place in connected and not d.added:
            raise InputInvalid(
                f"--input {d.name}: is connected to {connected[place]}",
                f"+{d.name}, which adds to that signal, or an unconnected input",
            )
        if d.variable.causality != "input" and not d.added:
            raise InputInvalid(
                f"--input {d.name}: is an {d.variable.causality}",
                f"+{d.name}, which adds to it, or an unconnected input",
            )
        if d.variable.causality != "input" or place in connected:
            # A fault of a signal acts from the first step's transfer on, not at the start.
            d = replace(d, note=f"{d.note}; added from the end of the first step on")
        noted.append(d)
    return tuple(noted)


def _connected(plan: Plan) -> dict[tuple[str, str, int], str]:
    """Return the source of each connected element: component, variable, element -> signal."""
    return {
        (plan.components[t.target].path, t.target_variable.name, e):
            f"{plan.components[t.source].path}.{t.source_variable.element_name(s)}"
        for t in plan.transfers
        for s, e in zip(t.source_elements, t.target_elements, strict=True)
    }  # fmt: skip


def _of_file(path: Path, plan: Plan) -> list[Drive]:
    """Read a table; its columns are named after variables of the plan, with or without "+"."""
    places: dict[str, tuple[str, Variable]] = {}
    for c in plan.components:
        for v in c.description.of("input", "output"):
            if v.type not in ("String", "Binary", "Clock"):
                places[f"{c.path}.{v.name}"] = (c.path, v)
    named = {
        sign + name: replace(v, name=sign + name, causality="input", start=None)
        for name, (_, v) in places.items()
        for sign in ("", "+")
        if not (sign and v.type in ("Boolean", "Enumeration"))
    }
    series = read_input_csv(path, Description(path.name, "native", named))
    drives: list[Drive] = []
    for s in series:
        component, variable = places[s.variable.name.lstrip("+")]
        between = "linear" if variable.variability == "continuous" else "held"
        end = f"{s.time[0]:g} … {s.time[-1]:g} s"
        d = Drive(
            component, variable, s.element, s.variable.name.startswith("+"),
            # A number of Python, whose `repr` is the text of the log.
            lambda t, s=s: np.asarray(s.at(t)).item(),  # type: ignore[misc]
            f"{path.name}, {between} between its rows, held outside {end}",
        )  # fmt: skip
        if not d.added and len(beyond := np.flatnonzero(_beyond(variable, s.values))):
            k = int(beyond[0])
            more = f", and {len(beyond) - 1} more rows" if len(beyond) > 1 else ""
            raise _refused(
                d, f"{path}, row {k + 1} (t = {s.time[k]:g} s)", s.values[k].item(), more
            )
        drives.append(replace(d, note=f"input {d.name} in {_unit(d)}: {d.note}"))
    return drives


def _beyond(variable: Variable, values: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which values are outside of a variable's [min, max]."""
    beyond = np.zeros(values.shape, dtype=bool)
    if variable.min is not None:
        beyond |= values < variable.min
    if variable.max is not None:
        beyond |= values > variable.max
    return beyond


def _refused(d: Drive, place: str, value: object, more: str = "") -> InputInvalid:
    unit = f" {_unit(d)}" if _unit(d) != "1" else ""
    return InputInvalid(
        f"{place}: {d.name}",
        f"{value:g}{unit} is out of range{more}" if isinstance(value, float) else f"{value}{more}",
        f"a value in {range_text(d.variable)}{unit}",
    )


def _of_waveform(text: str, plan: Plan) -> list[Drive]:
    name, _, rest = text.partition(":")
    added, place = name.startswith("+"), f"--input {name}"
    descriptions: Mapping[str, Description] = {c.path: c.description for c in plan.components}
    try:
        point = resolve_endpoint(name.removeprefix("+"), descriptions)
    except Misfit as misfit:
        raise InputInvalid(str(misfit.at(place))) from None
    if point.variable.type not in ("Float64", "Float32"):
        raise InputInvalid(place, f"is a {point.variable.type}", "a Float64 or Float32")
    wave = waveform(rest, place)
    drives: list[Drive] = []
    for element in point.elements:
        size = _size(wave, point.variable, element, added, descriptions[point.element], place)
        d = Drive(
            point.element, point.variable, element, added,
            lambda t, k=size: k * wave.of(t),  # type: ignore[misc]
            "",
        )  # fmt: skip
        # A step ends at 0; the other waveforms swing about it.
        ends = [] if math.isinf(wave.until) else [0.0]
        reached = np.array([size, *ends] if wave.kind == "step" else [size, -size])
        if not added and len(wrong := reached[_beyond(point.variable, reached)]):
            raise _refused(d, f"--input {text}", wrong[0].item())
        drives.append(replace(d, note=f"input {d.name} in {_unit(d)}: {rest}"))
    return drives


def _size(
    wave: Waveform, variable: Variable, element: int, added: bool, description: Description,
    place: str,
) -> float:  # fmt: skip
    """Convert a waveform's size to the variable's unit; a difference gets no offset."""
    unit = variable.units[element]
    scalar = replace(variable, shape=(), unit=None, element_units=(), min=None, max=None)
    number, _, own = wave.size.partition(" ")
    try:
        value = float(fit(scalar, number))
    except Misfit as misfit:
        raise InputInvalid(str(misfit.at(place))) from None
    if not own.strip() or unit is None:
        return value
    pair = conversion(own.strip(), unit, description.units, of_value=True)
    if pair is None:
        raise InputInvalid(
            place, f"{wave.size!r} is in {own.strip()!r}", f"{unit!r} or a unit of its kind"
        )
    absolute = wave.kind == "step" and not added
    return pair[0] * value + (pair[1] if absolute else 0.0)


def _unit(d: Drive) -> str:
    return d.variable.units[d.element] or "1"


@final
class Driven(SteppedMaster):
    """Steps of a master whose inputs change over time.

    With `log`, the applied values are written there as CSV, one row for each communication point.
    The file can be used as input again and gives the same values, to the last bit.
    """

    def __init__(
        self, steps: Steps, master: Master, drives: Sequence[Drive], log: Path | None = None
    ) -> None:
        super().__init__(master)
        self._steps, self._drives = steps, tuple(drives)
        connected = _connected(master.plan)
        self._set: list[tuple[Drive, np.ndarray, float]] = []  # drive, slots, value to add to
        self._biased: list[tuple[Drive, str, float]] = []  # drive, signal, factor
        for d in self._drives:
            fed = (d.component, d.variable.name, d.element) in connected
            if d.variable.causality == "input" and not fed:
                slots = master.slots(d.component, d.variable.name)
                assert slots is not None  # the input is held (`held_by`), and a number
                self._set.append((d, slots, slots[d.element].item() if d.added else 0))
                continue
            if master.plan.variable is not None:
                raise InputInvalid(
                    f"--input {d.name}",
                    "a value that is added to a connection, with a variable communication step",
                    "an input that is not connected, or a fixed step",
                )
            bias = Manipulation(0.0, d.name.removeprefix("+"), "bias", 1.0)
            for event in events_of(bias, master):
                assert isinstance(event, SignalFault)
                self._biased.append((d, event.fault.signal, event.fault.value))
        self._begun = False
        self._active: dict[str, tuple[int, float]] = {}  # by signal: number of the fault, value
        self._log = None if log is None else log.open("w", encoding="utf-8", newline="")
        self._row("time", *(f'"{d.name}"' if "," in d.name else d.name for d in self._drives))

    def step(self, n: int = 1) -> None:
        """Make n communication steps, with the inputs of each."""
        end = self._master.tick + n
        while self._master.tick < end:
            if not self._begun:
                self._begun = True
                self._write()
            now = self._master.time
            later = float((self._master.tick + 1) * self._master.plan.tick)
            for d, slots, base in self._set:
                slots[d.element] = base + d.of(now)
            for d, signal, factor in self._biased:  # receivers get it at the end of the step
                value = factor * d.of(later)
                number, present = self._active.get(d.name, (0, 0.0))
                if value != present:
                    if number:
                        self._master.faults.clear(number)
                    number = self._master.faults.add(Fault(signal, "bias", value))
                    self._active[d.name] = (number, value)
            self._steps.step(1)
            self._write()

    def close(self) -> None:
        """Close the file of applied values; a second call does nothing."""
        if self._log is not None:
            self._log.close()

    def _write(self) -> None:
        """Write the values at the communication point that has been reached."""
        now = self._master.time
        values = [d.of(now) for d in self._drives]
        self._row(repr(now), *(str(v).lower() if isinstance(v, bool) else repr(v) for v in values))

    def _row(self, *cells: str) -> None:
        if self._log is None:
            return
        try:
            self._log.write(",".join(cells) + "\n")
        except OSError as error:
            raise RecordingError(self._log.name, error.strerror, "room") from None


def held_by(drives: Sequence[Drive], plan: Plan) -> list[tuple[str, str]]:
    """Return the inputs that a master has to hold (`Master`, `hold`) for the drives."""
    connected = _connected(plan)
    return list(
        dict.fromkeys(
            (d.component, d.variable.name)
            for d in drives
            if d.variable.causality == "input"
            and (d.component, d.variable.name, d.element) not in connected
        )
    )


def start_values(drives: Sequence[Drive], at: float) -> dict[str, float]:
    """Return the start values of unconnected inputs, by ``component.variable[index]``."""
    return {d.name: d.of(at) for d in drives if not d.added}
