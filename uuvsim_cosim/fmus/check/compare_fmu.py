"""Differences between the interfaces of two FMUs: variables, capabilities, terminals, experiment.

A unit is equal if its definition is: `rad/s` and `rad.s-1` are one unit, and two units of the same
name with other factors are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element

import numpy as np

from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.importer.safe_xml import read_xml
from uuvsim_cosim.models.declaration.units import Unit, parse_unit

__all__ = ["Difference", "compare_interfaces"]

Topic = Literal["FMU", "capability", "experiment", "variable", "terminal"]
_BOOLEAN = ("can", "has", "provides", "needs", "might")
_EXPERIMENT = ("startTime", "stopTime", "tolerance", "stepSize")
# FMI 3.0 spells two of the attributes of FMI 2.0 in another way.
_AS_IN_FMI3 = {
    "canGetAndSetFMUstate": "canGetAndSetFMUState",
    "canSerializeFMUstate": "canSerializeFMUState",
    "providesDirectionalDerivative": "providesDirectionalDerivatives",
}
NOTHING = "-"  # the value of a property that an FMU does not have


@dataclass(frozen=True)
class Difference:
    """One property that differs; "-" where one of the FMUs does not have it."""

    topic: Topic
    name: str  # of the variable, the capability or the terminal
    property: str
    a: str
    b: str


def compare_interfaces(a: Path, b: Path) -> list[Difference]:
    """List the differences between the interfaces of two FMUs; none if these are equal.

    Arrays are compared as such in FMI 2.0 as well, where their elements are ``x[1]`` … ``x[n]``.
    Raises FmuError if one cannot be read.
    """
    one, other = read_fmu(a), read_fmu(b)
    found = [
        Difference("FMU", "", key, value, theirs)
        for (key, value), theirs in zip(_facts(one).items(), _facts(other).values(), strict=True)
        if value != theirs
    ]
    roots = [read_xml(f.folder / "modelDescription.xml", place=str(f.path)) for f in (one, other)]
    found += _pairs("capability", *map(_capabilities, roots))
    found += _pairs("experiment", *map(_experiment, roots))
    found += _variables(one.description, other.description)
    found += _pairs("terminal", _terminals(one), _terminals(other))
    return found


def _facts(fmu: FmuArchive) -> dict[str, str]:
    return {
        "FMI version": fmu.description.kind.removeprefix("FMI "),
        "interfaces": ", ".join(fmu.interfaces),
    }


def _pairs(
    topic: Topic, a: Mapping[tuple[str, str], str], b: Mapping[tuple[str, str], str]
) -> Iterator[Difference]:
    """Compare texts by name and property."""
    for name, key in dict.fromkeys((*a, *b)):
        values = a.get((name, key), NOTHING), b.get((name, key), NOTHING)
        if values[0] != values[1]:
            yield Difference(topic, name, key, *values)


def _capabilities(root: Element) -> dict[tuple[str, str], str]:
    """Return the capabilities of each interface; those at FMI's default, false or 0, are left out.

    An interface that only one FMU has is a difference of its own.
    """
    found = {}
    fmi1 = root.find("Implementation/CoSimulation_StandAlone/Capabilities")
    for interface in ("CoSimulation", "ModelExchange", "ScheduledExecution"):
        element = root.find(interface)
        if interface == "CoSimulation" and fmi1 is not None:
            element = fmi1
        for key, text in () if element is None else element.attrib.items():
            value = text.strip()
            if key.startswith(_BOOLEAN):
                value = {"1": "true", "0": "false"}.get(value, value)
            if key != "modelIdentifier" and value not in ("false", "0"):
                found[interface, _AS_IN_FMI3.get(key, key)] = value
    return found


def _experiment(root: Element) -> dict[tuple[str, str], str]:
    element = root.find("DefaultExperiment")
    given = {} if element is None else element.attrib
    return {("", key): f"{float(given[key]):.17g}" for key in _EXPERIMENT if key in given}


def _variables(a: Description, b: Description) -> Iterator[Difference]:
    for name in dict.fromkeys((*a.variables, *b.variables)):
        if name not in a.variables or name not in b.variables:
            known = a.variables.get(name) or b.variables[name]
            text = f"{known.causality}, {_size(known)}{known.type}"
            both = (text, NOTHING) if name in a.variables else (NOTHING, text)
            yield Difference("variable", name, "there", *both)
            continue
        v, w = a.variables[name], b.variables[name]
        mine, theirs = _properties(v), _properties(w)
        for key, value in mine.items():
            if value != theirs[key]:
                yield Difference("variable", name, key, value, theirs[key])
        defined = [_defined(u, a) for u in v.units], [_defined(u, b) for u in w.units]
        if v.shape != w.shape:  # compare the units that occur
            defined = list(dict.fromkeys(defined[0])), list(dict.fromkeys(defined[1]))
        if defined[0] != defined[1]:
            units = v.unit_text or NOTHING, w.unit_text or NOTHING
            if units[0] == units[1]:  # one name with two definitions
                units = f"{units[0]} {_definition(v, a)}", f"{units[1]} {_definition(w, b)}"
            yield Difference("variable", name, "unit", *units)


def _properties(v: Variable) -> dict[str, str]:
    """Return what a master reads of a variable, as text; its unit is compared by definition."""
    start = NOTHING if v.start is None else repr(np.asarray(v.start).tolist())
    depends = NOTHING if v.dependencies is None else ", ".join(sorted(v.dependencies)) or "nothing"
    return {
        "causality": v.causality,
        "type": v.type,
        "dimensions": " x ".join(map(str, v.shape)) or "scalar",
        "variability": v.variability,
        "initial": v.initial or NOTHING,
        "start": start,
        "min": NOTHING if v.min is None else f"{v.min:.17g}",
        "max": NOTHING if v.max is None else f"{v.max:.17g}",
        "items": ", ".join(f"{item} = {n}" for item, n in v.items) or NOTHING,
        "depends on": depends,
        "sign": "negated alias" if v.negated else NOTHING,
    }


def _size(v: Variable) -> str:
    return f"{' x '.join(map(str, v.shape))} of " if v.shape else ""


def _unit(name: str | None, d: Description) -> Unit | None:
    if name is None:
        return None
    try:
        return d.units.get(name) or parse_unit(name)
    except ValueError:
        return None


def _defined(name: str | None, d: Description) -> object:
    """Return a unit's definition; its name if the FMU does not define it and we do not know it."""
    unit = _unit(name, d)
    return name if unit is None else (unit.exponents, unit.factor, unit.offset)


def _definition(v: Variable, d: Description) -> str:
    unit = _unit(v.units[0], d)
    if unit is None:
        return "(not defined)"
    shift = f" + {unit.offset:.17g}" if unit.offset else ""
    return f"(factor {unit.factor:.17g}{shift}, exponents {' '.join(map(str, unit.exponents))})"


def _terminals(fmu: FmuArchive) -> dict[tuple[str, str], str]:
    """Return the terminals of FMI 3.0 by path: rule, kind, and the variable of each member."""
    file = fmu.folder / "terminalsAndIcons" / "terminalsAndIcons.xml"
    found: dict[tuple[str, str], str] = {}

    def read(element: Element, outer: str) -> None:
        for each in element.iterfind("Terminal"):
            name = f"{outer}{each.get('name', '')}"
            found[name, "matching rule"] = each.get("matchingRule", NOTHING)
            found[name, "kind"] = each.get("terminalKind", NOTHING)
            for member in each.iterfind("TerminalMemberVariable"):
                variable, kind = member.get("variableName", ""), member.get("variableKind", "")
                found[name, f"member {member.get('memberName', variable)}"] = f"{variable}, {kind}"
            for stream in each.iterfind("TerminalStreamMemberVariable"):
                variable = stream.get("outStreamVariableName", "")
                found[name, f"stream {stream.get('outStreamMemberName', variable)}"] = variable
            read(each, f"{name}.")

    if file.is_file():
        for terminals in read_xml(file, place=f"{fmu.path}/{file.name}").iterfind("Terminals"):
            read(terminals, "")
    return found
