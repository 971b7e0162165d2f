"""Reader of study files (YAML): every mistake is reported with its line and a correction."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from uuvsim_cosim.envs.randomisation.distributions import Choice
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation
from uuvsim_cosim.envs.randomisation.targets import Declared, Places, Vary
from uuvsim_cosim.envs.randomisation.yaml_text import declared_in
from uuvsim_cosim.errors import InputInvalid, SystemInvalid, UuvsimError
from uuvsim_cosim.models.declaration.yaml_text import YamlText, plain, shown
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.system.elements import Loops, Mismatches
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.metric import Metric, read_metric
from uuvsim_cosim.studies.run_table import MOST_RUNS, Runs, check_runs, check_seeds

__all__ = ["StudyOptions", "read_study"]

KEYS = (
    "system", "set", "duration", "every", "parameters", "sets", "correlation", "seeds", "metrics",
    "output", "name", "loops",
)  # fmt: skip
_SECONDS = {"s": Fraction(1), "ms": Fraction(1, 1000), "min": Fraction(60), "h": Fraction(3600)}


class StudyOptions(TypedDict):
    """Arguments of `Study`, as a study file gives them."""

    system: System
    duration: Fraction
    metrics: dict[str, Metric]
    parameters: Randomisation
    grid: list[Vary]
    seeds: int | list[int]
    every: Fraction | None
    name: str
    output: str | None


def read_study(
    path: Path, loops: Loops | None = None, mismatches: Mismatches | None = None
) -> StudyOptions:
    """Read a study file; raises InputInvalid with every mistake and its line.

    `loops` is the policy for algebraic loops instead of the file's, `mismatches` that for parts of
    another vehicle instead of the system's.
    """
    text = YamlText(path, "a study")
    if not text.keys([], text.data, KEYS):
        text.refuse()
    data = text.data
    for key in ("system", "duration", "metrics"):
        if key not in data:
            text.wrong([], f"{key} missing; expected {', '.join(KEYS[:3])} …, at least "
                       "system, duration and metrics")  # fmt: skip
    system = _system(text, data, loops, mismatches)
    tick = None if system is None else system.base_step
    duration = _seconds(text, data, ["duration"], tick)
    every = _seconds(text, data, ["every"], tick) if "every" in data else None
    seeds: Any = plain(data.get("seeds", 1))
    try:
        check_seeds(seeds)
    except InputInvalid as error:
        text.wrong(["seeds"], str(replace(error.problems[0], place="")))
    for key in ("output", "name"):
        if key in data and not isinstance(data[key], str):
            text.wrong([key], f"{shown(data[key])}; expected a text")
    metrics = _metrics(text, data, system, duration)
    grid, gridded = _grid(text, data)
    drawn: Declared | None = None
    if system is not None:
        drawn = declared_in(text, data, system, skip=gridded, also=("grid",))
        _check_runs(text, data, system, grid, drawn)
    text.refuse()
    assert system is not None
    assert drawn is not None
    assert duration is not None
    return StudyOptions(
        system=system,
        duration=duration,
        metrics=metrics,
        parameters=Randomisation(*drawn, system),
        grid=grid,
        seeds=seeds,
        every=every,
        name=str(data.get("name", path.stem)),
        output=data.get("output"),
    )


def _system(
    text: YamlText, data: Mapping[str, Any], loops: Loops | None, mismatches: Mismatches | None
) -> System | None:
    """Load the system: a name, or a file beside the study; then apply `set` and the policies."""
    given = data.get("system")
    if given is None:
        return None
    if not isinstance(given, str):
        text.wrong(["system"], f"{shown(given)}; expected a name, or the path of an .ssd")
        return None
    beside = text.path.parent / str(given).partition("#")[0]
    try:
        system = load(str(text.path.parent / given) if beside.is_file() else str(given))
    except UuvsimError as error:
        text.wrong(["system"], str(error))
        return None
    try:
        policy = data.get("loops") if loops is None else loops
        system = system if policy is None else system.with_loops(policy)
        system = system if mismatches is None else system.with_mismatches(mismatches)
        flatten(system)
    except UuvsimError as error:
        text.wrong(["loops"] if "loops" in data else ["system"], str(error))
        return None
    values = data.get("set")
    if values is not None and not isinstance(values, Mapping):
        text.wrong(["set"], f"{shown(values)}; expected values by component.parameter")
        return system
    for name, value in (values or {}).items():
        try:
            system = system.set(str(name), plain(value))
        except UuvsimError as error:
            text.wrong(["set", name], str(error))
    return system


def _seconds(
    text: YamlText, data: Mapping[str, Any], place: list[object], tick: Fraction | None
) -> Fraction | None:
    """Read a time: a number of seconds, or text such as "2 min"."""
    given = data.get(str(place[-1]))
    if given is None:
        return None
    match = re.fullmatch(r"\s*([0-9.eE+-]+)\s*([a-z]*)\s*", str(given))
    try:
        unit = _SECONDS[match[2] or "s"] if match and not isinstance(given, bool) else None
        value = Fraction(match[1]) * unit if match and unit else None
    except (KeyError, ValueError):
        value = None
    if value is None or value < 0:
        text.wrong(place, f"{shown(given)}; expected seconds, or a text such as '20 s', '2 min'")
        return None
    if tick is not None and (value / tick).denominator != 1:
        text.wrong(place, f"{shown(given)}; expected a multiple of the communication step, "
                   f"{float(tick):g} s")  # fmt: skip
        return None
    if value == 0 and place[-1] in ("duration", "every"):
        text.wrong(place, "0 s; expected more")
        return None
    return value


def _metrics(
    text: YamlText, data: Mapping[str, Any], system: System | None, duration: Fraction | None
) -> dict[str, Metric]:
    given = data.get("metrics")
    found: dict[str, Metric] = {}
    if given is None:
        return found
    if not isinstance(given, Mapping) or not given:
        text.wrong(["metrics"], f"{shown(given)}; expected expressions by name, such as "
                   "error: rms(guidance.cross_track)")  # fmt: skip
        return found
    descriptions = (
        {} if system is None else {c.path: c.description for c in flatten(system).components}
    )
    for name, entry in given.items():
        place = ["metrics", name]
        fields = {"expression": entry} if isinstance(entry, str) else entry
        if not text.keys(place, fields, ("expression", "after", "until")):
            continue
        expression = fields.get("expression")
        if not isinstance(expression, str):
            text.wrong(place, f"{shown(expression)}; expected an expression")
            continue
        times = {k: _seconds(text, fields, [*place, k], None) for k in ("after", "until")}
        metric = Metric(str(expression), times["after"] or Fraction(0), times["until"])
        end = duration if metric.until is None else metric.until
        if duration is not None and end is not None and not metric.after < end <= duration:
            text.wrong(place, f"from {float(metric.after):g} to {float(end):g} s; expected a "
                       f"window within 0 to {float(duration):g} s")  # fmt: skip
        if system is not None:
            try:
                read_metric(str(name), metric, descriptions)
            except InputInvalid as error:
                text.wrong(place, str(error))
        found[str(name)] = metric
    return found


def _grid(text: YamlText, data: Mapping[str, Any]) -> tuple[list[Vary], list[str]]:
    """Return the axes that can be read, and the names of all parameters that have a `grid`."""
    found: list[Vary] = []
    names: list[str] = []
    given = data.get("parameters")
    for name, entry in given.items() if isinstance(given, Mapping) else ():
        if not isinstance(entry, Mapping) or "grid" not in entry:
            continue
        names.append(name)
        place = ["parameters", name]
        text.keys(place, entry, ("grid", "unit", "relative", "together"))
        values = plain(entry["grid"])
        if isinstance(values, dict):
            values = _spaced(text, [*place, "grid"], values)
            if values is None:
                continue
        try:
            distribution = Choice(values)
        except InputInvalid as error:
            read, expected = error.problems[0].read, error.problems[0].expected
            text.wrong([*place, "grid"], f"{read}; expected a list of {expected}")
            continue
        flags = {k: entry.get(k, k == "together") for k in ("relative", "together")}
        for k, flag in flags.items():
            if not isinstance(flag, bool):
                text.wrong([*place, k], f"{shown(flag)}; expected true or false")
        unit = entry.get("unit")
        together = bool(flags["together"]) and not distribution.joint
        found.append(Vary(str(name), distribution, None if unit is None else str(unit),
                          bool(flags["relative"]), together))  # fmt: skip
    return found, names


def _check_runs(
    text: YamlText, data: Mapping[str, Any], system: System, grid: list[Vary],
    drawn: Declared | None,
) -> None:  # fmt: skip
    """Report too many runs, or else names and values that do not fit the system."""
    seeds = data.get("seeds", 1)
    count = len(seeds) if isinstance(seeds, Sequence) else seeds
    whole = isinstance(count, int) and not isinstance(count, bool) and count > 0
    points = math.prod(
        len(v.distribution.values) for v in grid if isinstance(v.distribution, Choice)
    )
    try:
        check_runs(points, int(count) if whole else 1)
    except InputInvalid as error:
        if not (whole and count > MOST_RUNS):  # else reported with the seeds
            text.wrong(["parameters"], str(error))
        return
    try:
        Runs(Randomisation(*(drawn or Declared(())), system), grid, (0,), Places(system))
    except SystemInvalid as error:
        names = {v.name for v in grid}
        for p in error.problems:
            place = ["parameters", p.place] if p.place in names else ["parameters"]
            text.wrong(place, f"{p.read}; expected {p.expected}")


def _spaced(text: YamlText, place: list[object], given: dict[str, object]) -> list[float] | None:
    """Read {from, to, count}: equally spaced values, both ends included."""
    if not text.keys(place, given, ("from", "to", "count")):
        return None
    low, high, count = (given.get(k) for k in ("from", "to", "count"))
    numbers = all(isinstance(x, int | float) and not isinstance(x, bool) for x in (low, high))
    if not numbers or isinstance(count, bool) or not isinstance(count, int) or count < 2:
        text.wrong(place, f"{shown(given)}; expected from, to, and a count of 2 or more")
        return None
    try:
        check_runs(count, 1)
    except InputInvalid as error:
        text.wrong([*place, "count"], str(error))
        return None
    return [float(x) for x in np.linspace(float(low), float(high), count)]  # type: ignore[arg-type]
