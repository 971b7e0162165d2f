"""Reader of the variables of an FMI 3.0 model description: all types, arrays, aliases."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any, get_args
from xml.etree.ElementTree import Element

import numpy as np

from uuvsim_cosim.fmus.description import (
    UNITS_ANNOTATION,
    ClockTiming,
    IntervalVariability,
    Variable,
    VariableType,
)
from uuvsim_cosim.fmus.description_xml import DTYPES, SimpleType, Source

__all__ = ["read_variables_fmi3"]

MAX_SIZE = 10**8
_WHOLE = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")


def read_variables_fmi3(
    source: Source, root: Element
) -> tuple[dict[str, Variable], dict[str, Mapping[int, str]]]:
    """Return the variables by name, and the items of those that are enumerations."""
    types = {
        source.required(e, "name", "a type"): SimpleType(
            dict(e.attrib), source.items(e, f"type {e.get('name')!r}")
        )
        for e in root.iterfind("TypeDefinitions/*")
    }
    elements = [e for e in root.iterfind("ModelVariables/*") if e.tag in get_args(VariableType)]
    # Start values of structural parameters, by value reference. Those of other types, for example a
    # Boolean that selects equations, cannot be a dimension.
    extents: dict[int, int] = {}
    for e in elements:
        if e.get("causality") != "structuralParameter" or e.find("Dimension") is not None:
            continue
        where = f"structural parameter {e.get('name')!r}"
        start = e.get("start")
        if start is None:
            raise source.fault(where, "no start", "a start value")
        value = source.value(e.tag, start, where)  # type: ignore[arg-type]
        if e.tag in _WHOLE:
            extents[source.natural(e.get("valueReference"), "valueReference", where)] = value
    variables: dict[str, Variable] = {}
    enumerations: dict[str, Mapping[int, str]] = {}
    for element in elements:
        variable, declared = _variable(source, element, types, extents)
        aliases = [
            replace(variable, name=alias.get("name", ""), causality="local")
            for alias in element.iterfind("Alias")
        ]
        for v in (variable, *aliases):
            if v.name in variables:
                raise source.fault(f"variable {v.name!r}", "declared twice", "unique names")
            variables[v.name] = v
            if v.type == "Enumeration" and declared is not None:
                enumerations[v.name] = declared.items
    known = {v.value_references[0]: v for v in reversed(list(variables.values()))}
    path, expected = "ModelStructure/Output", "that of a variable"
    outputs = source.dependencies(root, path, "valueReference", known, "value reference", expected)
    for reference, names in outputs.items():
        name = known[reference].name
        variables[name] = replace(variables[name], dependencies=names)
    for element in elements:
        _add_clocks(source, element, variables, known)
    return variables, enumerations


def _add_clocks(
    source: Source,
    element: Element,
    variables: dict[str, Variable],
    known: Mapping[int, Variable],
) -> None:
    """Read the clocks of a clocked variable.

    Between their ticks its value holds, so that it passes on no input at once.
    """
    if not element.get("clocks"):
        return
    where = f"variable {element.get('name')!r}"
    names = []
    for word in element.get("clocks", "").split():
        clock = known.get(source.natural(word, "clock", where))
        if clock is None or clock.type != "Clock":
            raise source.fault(where, f"clocks={word!r}", "the value reference of a Clock")
        names.append(clock.name)
    for name in (element.get("name", ""), *(a.get("name", "") for a in element.iterfind("Alias"))):
        variables[name] = replace(variables[name], clocks=tuple(names), dependencies=())


def _timing(source: Source, attributes: Mapping[str, str], where: str) -> ClockTiming:
    """Read when a clock ticks; raises FmuError for an interval that is not positive."""

    def seconds(decimal: str, counter: str) -> Fraction | None:
        if attributes.get(counter) and attributes.get("resolution"):
            resolution = source.natural(attributes["resolution"], "resolution", where)
            if resolution == 0:
                raise source.fault(where, "resolution 0", "1 or more")
            return Fraction(source.natural(attributes[counter], counter, where), resolution)
        if attributes.get(decimal) is None:
            return None
        number = source.number(attributes, decimal, where)
        if not math.isfinite(number):
            raise source.fault(where, f"{decimal} {number} s", "a finite number")
        return Fraction(repr(number))

    variability = attributes.get("intervalVariability", "")
    if variability not in get_args(IntervalVariability):
        expected = f"one of {', '.join(get_args(IntervalVariability))}"
        raise source.fault(where, f"intervalVariability {variability!r}", expected)
    timing = ClockTiming(
        variability=variability,  # type: ignore[arg-type]
        interval=seconds("intervalDecimal", "intervalCounter"),
        shift=seconds("shiftDecimal", "shiftCounter") or Fraction(),
        supports_fraction=attributes.get("supportsFraction", "false") in ("true", "1"),
        priority=source.natural(attributes.get("priority", "0"), "priority", where),
    )
    if timing.is_periodic and timing.interval is not None and timing.interval <= 0:
        raise source.fault(where, f"an interval of {float(timing.interval):g} s", "more than 0 s")
    if timing.shift < 0:
        raise source.fault(where, f"a shift of {float(timing.shift):g} s", "0 s or more")
    if variability == "constant" and timing.interval is None:
        raise source.fault(where, "a constant clock without an interval", "intervalDecimal")
    return timing


def _variable(
    source: Source, element: Element, types: Mapping[str, SimpleType], extents: Mapping[int, int]
) -> tuple[Variable, SimpleType | None]:
    name = source.required(element, "name", "a variable")
    where = f"variable {name!r}"
    type_: VariableType = element.tag  # type: ignore[assignment]
    declared, attributes = source.declared(element, types, where)
    extent: list[int] = []
    for dimension in element.iterfind("Dimension"):
        if dimension.get("start") is not None:
            extent.append(source.natural(dimension.get("start"), "Dimension start", where))
            continue
        text = dimension.get("valueReference")
        reference = source.natural(text, "Dimension valueReference", where)
        if reference not in extents:
            raise source.fault(
                where,
                f"a dimension by value reference {reference}",
                "that of a whole structural parameter",
            )
        extent.append(source.natural(str(extents[reference]), "Dimension", where))
    shape = tuple(extent)
    size = math.prod(shape)
    if size > MAX_SIZE:
        raise source.fault(where, f"{size} elements", f"at most {MAX_SIZE}")
    # FMI 3.0 has one unit for an array; if those of elements differ, our annotation lists them.
    note = element.find(f"Annotations/Annotation[@type='{UNITS_ANNOTATION}']")
    units = tuple((note.text or "").split()) if note is not None else ()
    variable = source.variable(
        element,
        attributes,
        type_,
        where,
        shape=shape,
        element_units=units if len(units) == size else (),
        start=_start(source, element, type_, shape, where),
        description=attributes.get("description", ""),
        timing=_timing(source, attributes, where) if type_ == "Clock" else None,
    )
    return variable, declared


def _start(
    source: Source, element: Element, type_: VariableType, shape: tuple[int, ...], where: str
) -> Any:
    if type_ in ("String", "Binary"):
        texts = [e.get("value", "") for e in element.iterfind("Start")]
    elif shape:
        texts = element.get("start", "").split()
    else:
        texts = [element.get("start", "")] if element.get("start") is not None else []
    if not texts:
        return None
    values = [source.value(type_, text, where) for text in texts]
    if not shape:
        return values[0]
    size = math.prod(shape)
    if len(values) == 1:
        values = values * size
    if len(values) != size:
        raise source.fault(where, f"{len(values)} start values", f"1 or {size}")
    flat = np.empty(size, dtype=DTYPES[type_])
    try:
        flat[:] = values
    except OverflowError:
        raise source.fault(where, "a start value out of range", f"values of {type_}") from None
    return flat.reshape(shape)
