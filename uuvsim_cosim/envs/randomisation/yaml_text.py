"""Randomisations in YAML files; every mistake is reported with its line."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from uuvsim_cosim.envs.randomisation.copula import copula_problems
from uuvsim_cosim.envs.randomisation.distributions import (
    Choice,
    Constant,
    Distribution,
    LogUniform,
    Normal,
    Triangular,
    Uniform,
)
from uuvsim_cosim.envs.randomisation.sets import SETS, published_intervals
from uuvsim_cosim.envs.randomisation.targets import Declared, Places, Vary, resolved
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.yaml_text import YamlText, plain, shown
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["declared_in", "read_declared"]

Path_ = list[str | int]
KINDS: dict[str, tuple[type[Distribution], tuple[str, ...], int]] = {
    "uniform": (Uniform, ("low", "high"), 2),
    "log_uniform": (LogUniform, ("low", "high"), 2),
    "normal": (Normal, ("mean", "std", "min", "max"), 2),
    "triangular": (Triangular, ("low", "mode", "high"), 3),
    "choice": (Choice, ("values", "weights"), 1),
    "constant": (Constant, ("value",), 1),
}
OPTIONS = ("unit", "relative", "together")


def _vary(
    text: YamlText, place: Path_, name: str, data: object, also: Sequence[str]
) -> Vary | None:
    """Read one parameter: a number, a list, or a mapping with one kind of distribution."""
    if not isinstance(data, Mapping):
        data = {"constant": data}
    if not text.keys(place, data, (*KINDS, *OPTIONS, *also)):
        return None
    kinds = [k for k in data if k in KINDS]
    if len(kinds) != 1:
        read = f"{' and '.join(kinds)}" if kinds else "no distribution"
        text.wrong(place, f"{read}; expected one of {', '.join((*KINDS, *also))}")
        return None
    distribution = _distribution(text, [*place, kinds[0]], kinds[0], plain(data[kinds[0]]))
    flags: dict[str, bool] = {}
    for option in ("relative", "together"):
        flag = data.get(option, False)
        if not isinstance(flag, bool):
            text.wrong([*place, option], f"{shown(flag)}; expected true or false")
            return None
        flags[option] = flag
    unit = data.get("unit")
    if unit is not None and not isinstance(unit, str):
        text.wrong([*place, "unit"], f"{shown(unit)}; expected the name of a unit")
        return None
    if distribution is None:
        return None
    unit = None if unit is None else str(unit)
    return Vary(name, distribution, unit, flags["relative"], flags["together"])


def _distribution(text: YamlText, place: Path_, kind: str, given: object) -> Distribution | None:
    made, names, least = KINDS[kind]
    if isinstance(given, dict):
        if not text.keys(place, given, names):
            return None
        lacking = [n for n in names[:least] if n not in given]
        values = {n: given[n] for n in names if n in given}
    else:
        items = [given] if kind in ("choice", "constant") else given
        if not isinstance(items, list) or not least <= len(items) <= len(names):
            text.wrong(place, f"{shown(given)}; expected [{', '.join(names)}]")
            return None
        lacking, values = [], dict(zip(names, items, strict=False))
    if lacking:
        text.wrong(place, f"{', '.join(lacking)} missing; expected {', '.join(names[:least])}")
        return None
    try:
        return made(**values)
    except InputInvalid as error:
        text.wrong(place, str(error))
    return None


def declared_in(
    text: YamlText,
    data: Mapping[str, object],
    system: System,
    skip: Iterable[str] = (),
    also: Sequence[str] = (),
) -> Declared | None:
    """Read `parameters` (except those to skip), `sets` and `correlation` of a mapping.

    `also` are keys of a parameter that the skipped ones have, for messages.
    """
    parameters: list[tuple[Path_, Vary]] = []
    pairs: dict[tuple[str, str], float] = {}
    given = data.get("parameters")
    for name, entry in given.items() if isinstance(given, Mapping) else ():
        if name not in skip:
            vary = _vary(text, ["parameters", name], str(name), entry, also)
            parameters += [(["parameters", name], vary)] if vary is not None else []
    if given is not None and not isinstance(given, Mapping):
        text.wrong(["parameters"], f"{shown(given)}; expected a mapping by name of a variable")
    for i, entry in enumerate(_list(text, data, "sets")):
        ready = _set(text, ["sets", i], entry, system)
        if ready is not None:
            parameters += [(["sets", i], vary) for vary in ready.parameters]
            pairs.update(ready.correlation)
    places = Places(system)
    quantities, problems = resolved(places, [vary for _, vary in parameters])
    where = {vary.name: place for place, vary in reversed(parameters)}
    for p in problems:
        text.wrong(where.get(p.place, ["parameters"]), f"{p.read}; expected {p.expected}")
    written = _correlation(text, data)
    pairs.update({pair: rho for pair, (rho, _) in written.items()})
    complete = not problems and not text.mistakes
    if complete:
        for p in copula_problems(pairs, [q.label for q in quantities]):
            at = [w for pair, (_, w) in written.items() if " and ".join(pair) in p.place]
            text.wrong(at[0] if at else ["correlation"], f"{p.read}; expected {p.expected}")
    if text.mistakes:
        return None
    return Declared([vary for _, vary in parameters], pairs)


def _set(text: YamlText, place: Path_, entry: object, system: System) -> Declared | None:
    options = {"set": entry} if isinstance(entry, str) else entry
    if not isinstance(options, Mapping) or options.get("set") not in SETS:
        read = options.get("set") if isinstance(options, Mapping) else entry
        text.wrong(place, f"set {shown(read)}; expected {expected_names(read, SETS)}")
        return None
    name = str(options["set"])
    function = published_intervals if name == "published" else SETS[name]
    allowed = [p for p in inspect.signature(function).parameters
               if p not in ("system", "set", "distribution")]  # fmt: skip
    text.keys(place, options, ["set", *allowed])
    given = {str(k): plain(v) for k, v in options.items() if k in allowed}
    try:
        return SETS[name](system, **given)
    except InputInvalid as error:
        text.wrong(place, str(error))
    except TypeError:
        text.wrong(place, f"{shown(given)}; expected numbers for {', '.join(allowed)}")
    return None


def _correlation(
    text: YamlText, data: Mapping[str, object]
) -> dict[tuple[str, str], tuple[float, Path_]]:
    found: dict[tuple[str, str], tuple[float, Path_]] = {}
    for i, entry in enumerate(_list(text, data, "correlation")):
        place: Path_ = ["correlation", i]
        if not text.keys(place, entry, ("between", "value")):
            continue
        pair, rho = plain(entry.get("between")), plain(entry.get("value"))
        if not (isinstance(pair, list) and len(pair) == 2):
            text.wrong([*place, "between"], f"{shown(pair)}; expected two names [a, b]")
        elif isinstance(rho, bool) or not isinstance(rho, int | float):
            text.wrong([*place, "value"], f"{shown(rho)}; expected a number in [-1, 1]")
        else:
            found[str(pair[0]), str(pair[1])] = (float(rho), place)
    return found


def _list(text: YamlText, data: Mapping[str, object], key: str) -> list[Any]:
    given = data.get(key)
    if given is None:
        return []
    if isinstance(given, str) or not isinstance(given, Sequence):
        text.wrong([key], f"{shown(given)}; expected a list")
        return []
    return list(given)


def read_declared(path: Path, system: System) -> Declared:
    """Read a file of `parameters`, `sets` and `correlation`; raises InputInvalid with all lines."""
    text = YamlText(path, "a randomisation")
    found = None
    if text.keys([], text.data, ("parameters", "sets", "correlation")):
        found = declared_in(text, text.data, system)
    text.refuse()
    assert found is not None
    return found
