"""A system of FMUs, whose outputs and inputs of equal names and units are connected.

Equal names are a guess at what belongs together. So only a pair that agrees in name, type,
dimensions and unit is connected, every connection is listed, and so is each input that stays open,
with the reason.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.check.reference_result import default_experiment
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.models.declaration.near_names import close_names
from uuvsim_cosim.orchestrator.system.elements import step_text
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.values.values import is_float, unit_named

__all__ = ["JoinedFmus", "OpenInput", "system_of_fmus"]

DEFAULT_STEP = Fraction(1, 100)  # [s] if no FMU states one


@dataclass(frozen=True)
class OpenInput:
    """An input without a source: outputs that have its name (or a similar one), and the reason."""

    target: str
    unit: str
    sources: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class JoinedFmus:
    """The system, the pairs that were connected by name, and the inputs that stay open."""

    system: System
    by_name: tuple[tuple[str, str], ...]
    open: tuple[OpenInput, ...]


def system_of_fmus(
    files: Sequence[Path],
    name: str = "system",
    *,
    connections: Iterable[tuple[str, str]] = (),
    step: Fraction | str | float | None = None,
) -> JoinedFmus:
    """Make a system of the FMUs in `files`, and connect outputs to inputs by name.

    Each component is named after its file. `connections` are (output, input) pairs that the user
    chose; they take precedence, and their units are converted. Without a `step` [s], each component
    has the step of its FMU, and the system's tick is their greatest common divisor. All assumptions
    are in the system's `remarks`. Raises FmuError, SystemInvalid, InputInvalid.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.fmus import build_fmu
    >>> from uuvsim_cosim.orchestrator.shipped.of_fmus import system_of_fmus
    >>> files = [build_fmu(uuv.declare(name)) for name in ("battery", "thruster_t200")]
    >>> joined = system_of_fmus(files)
    >>> joined.by_name[0]
    ('thruster_t200.current', 'battery.current')
    """
    if not files:
        raise InputInvalid("no FMU", "at least one")
    named = _named(files)
    archives = {each: read_fmu(path) for each, path in named.items()}
    tick, rates, remarks = _steps(archives, step)
    remarks += _times(archives)
    system = System(name, tick, ", ".join(archives))
    for each, fmu in archives.items():
        rate = rates.get(each)
        rate = None if rate == tick else rate
        source, text = str(named[each]), fmu.description.description
        system = system.add(each, source, rate=rate, description=text)
    for source, target in connections:
        system = system.connect(source, target)
    system, by_name, still_open = _joined(system)
    stops = [f.default_stop_time for f in archives.values() if f.default_stop_time is not None]
    return JoinedFmus(
        replace(system, remarks=tuple(remarks), stop_time=max(stops, default=None)),
        by_name,
        still_open,
    )


def _named(files: Sequence[Path]) -> dict[str, Path]:
    """Name each FMU after its file, by letters, digits and _; equal names get a number."""
    found: dict[str, Path] = {}
    for path in files:
        stem = re.sub(r"\W+", "_", path.stem) or "fmu"
        name, number = stem, 1
        while name in found:
            number += 1
            name = f"{stem}_{number}"
        found[name] = path
    return found


def _steps(
    archives: Mapping[str, FmuArchive], step: Fraction | str | float | None
) -> tuple[Fraction, dict[str, Fraction], list[str]]:
    """Return the tick, the communication step of each FMU that states one, and the remarks."""
    stated = {}
    for name, fmu in archives.items():
        number = default_experiment(fmu)[2]
        if number is not None and number > 0:
            stated[name] = Fraction(repr(number))
    if step is not None:
        try:
            tick = Fraction(str(step))
        except (ValueError, ZeroDivisionError):
            tick = Fraction(0)
        if tick <= 0:
            raise InputInvalid(f"step {step}", "seconds, more than 0, such as 0.01 or 1/60")
        other = [f"{n} {step_text(s)} s" for n, s in stated.items() if s != tick]
        remark = f"step: {step_text(tick)} s for all; the FMUs state {', '.join(other)}"
        return tick, {}, [remark] if other else []
    if not stated:
        text = f"step: {step_text(DEFAULT_STEP)} s, because no FMU states one"
        return DEFAULT_STEP, {}, [text]
    denominator = math.lcm(*(s.denominator for s in stated.values()))
    tick = Fraction(math.gcd(*(int(s * denominator) for s in stated.values())), denominator)
    silent = [name for name in archives if name not in stated]
    text = f"step: {step_text(tick)} s for {', '.join(silent)}, which state none"
    return tick, stated, [text] if silent else []


def _times(archives: Mapping[str, FmuArchive]) -> list[str]:
    """Return remarks on start and stop times that the FMUs state and the system does not follow."""
    remarks = []
    for name, fmu in archives.items():
        if fmu.default_start_time:
            remarks.append(
                f"start time: 0 s; {name} states {fmu.default_start_time:g} s (--start of a run)"
            )
    stops = {n: f.default_stop_time for n, f in archives.items() if f.default_stop_time is not None}
    if len(set(stops.values())) > 1:
        listed = ", ".join(f"{name} {stop:g} s" for name, stop in stops.items())
        remarks.append(f"stop time: {max(stops.values()):g} s; the FMUs state {listed}")
    return remarks


def _joined(
    system: System,
) -> tuple[System, tuple[tuple[str, str], ...], tuple[OpenInput, ...]]:
    """Connect what agrees in name, type, dimensions and unit; list the inputs that stay open."""
    descriptions = system.checked.descriptions
    fed = {(w.target.element, w.target.variable.name) for w in system.checked.wires}
    offered: dict[str, list[tuple[str, Variable]]] = {}
    for element in system.elements:
        for v in descriptions[element.name].of("output"):
            offered.setdefault(v.name, []).append((element.name, v))
    pairs: list[tuple[str, str]] = []
    still_open: list[OpenInput] = []
    for element in system.elements:
        d = descriptions[element.name]
        for v in d.of("input"):
            if (element.name, v.name) in fed:
                continue
            others = offered.get(v.name, ())  # not of this FMU, whose names are unique
            reasons = {f"{e}.{o.name}": _misfit(system, e, o, element.name, v) for e, o in others}
            fitting = [source for source, reason in reasons.items() if not reason]
            target = f"{element.name}.{v.name}"
            if len(fitting) == 1:
                pairs.append((fitting[0], target))
                continue
            sources = tuple(fitting or reasons)
            reason = f"{len(fitting)} outputs fit" if fitting else "; ".join(reasons.values())
            if not others:
                close = close_names(v.name, (n for n in offered if n != v.name), 0.8)
                sources = tuple(f"{e}.{n}" for n in close for e, _ in offered[n]
                                if e != element.name)  # fmt: skip
                reason = "no output of this name" + (", but of a similar one" if sources else "")
            still_open.append(OpenInput(target, v.unit_text, sources, reason))
    for source, target in pairs:
        system = system.connect(source, target)
    return system, tuple(pairs), tuple(still_open)


def _misfit(system: System, a: str, output: Variable, b: str, target: Variable) -> str:
    """Return why an output is not connected to the input of its name; "" if it fits."""
    if output.shape != target.shape:
        sizes = (" x ".join(map(str, v.shape)) or "a scalar" for v in (output, target))
        return "dimensions: {} to {}".format(*sizes)
    if output.type != target.type:
        return f"type {output.type} to {target.type}{_possible(system, a, output, b, target)}"
    if not is_float(target):
        return ""
    da, db = system.checked.descriptions[a], system.checked.descriptions[b]
    for x, y in zip(output.units, target.units, strict=True):
        if x is None or y is None:
            if x is not y:
                return f"unit {x or 'not stated'} to {y or 'not stated'}"
            continue
        ux, uy = unit_named(x, da.units), unit_named(y, db.units)
        if ux is None or uy is None:
            if x != y:
                return f"unit {x} to {y}, of which one is unknown"
        elif not ux.commensurable(uy):
            return f"unit {x} to {y}, another quantity"
        elif (ux.factor, ux.offset) != (uy.factor, uy.offset):
            factor, offset = ux.conversion_to(uy)
            shift = f" + {offset:g}" if offset else ""
            return f"unit {x} to {y}: conversion by {factor:g}{shift}"
    return ""


def _possible(system: System, a: str, output: Variable, b: str, target: Variable) -> str:
    try:
        system.connect(f"{a}.{output.name}", f"{b}.{target.name}")
    except SystemInvalid:
        return ", not possible"
    return ""
