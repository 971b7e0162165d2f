"""Export of a declaration's modelDescription.xml for FMI 2.0 or FMI 3.0."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.fmus.codegen.dependencies import (
    KINDS,
    derivative_knowns,
    direct_kinds,
    initial_knowns,
)
from uuvsim_cosim.fmus.codegen.describe import describe
from uuvsim_cosim.fmus.codegen.equations import Equations
from uuvsim_cosim.fmus.description import UNITS_ANNOTATION, Description, Variable
from uuvsim_cosim.fmus.export.experiment import experiment_of
from uuvsim_cosim.models.declaration.units import BASE, Unit, parse_unit

__all__ = [
    "FmiVersion",
    "add_experiment",
    "add_interface",
    "add_units",
    "add_variables",
    "document",
    "model_description",
    "model_identifier",
    "number_text",
    "xml_text",
]

FmiVersion = Literal[2, 3]
_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9]*(\.[A-Za-z_][A-Za-z_0-9]*)*$")
_FMI2_TYPES = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean", "String": "String"}
_PER_TIME = re.compile(r"/s(\d*)$")


def model_identifier(name: str) -> str:
    """Return the name as a C identifier, which FMI requires; it is also the binary's name."""
    identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
    return identifier if re.match(r"[A-Za-z_]", identifier) else f"_{identifier}"


def model_description(
    eq: Equations, *, fmi: FmiVersion, token: str, sources: Sequence[str] = (), release: bool = True
) -> str:
    """Return the XML text; `sources` are listed in FMI 2.0, and the tool's version in a release."""
    model = eq.layout.model
    description = describe(model, eq)
    words = model.description
    if fmi == 2 and model.only_arrays:
        kept = {k: v for k, v in description.variables.items() if k not in model.only_arrays}
        description = replace(description, variables=kept)
        left_out = sorted(v.name for v in model.of_kind("output") if v.name in model.only_arrays)
        words = f"{words}; not in FMI 2.0: {', '.join(left_out)}"
    for name in description.variables:
        if name == "time" or _NAME.match(name) is None:
            raise ParameterInvalid(
                description.name,
                f"variable {name!r} cannot be exported",
                "a name of letters, digits, '_' and '.', other than 'time'",
            )
    tool = f"uuvsim-cosim {__version__}" if release else "uuvsim-cosim"
    root = document(fmi, model.name, token, words, tool)
    for interface in ("ModelExchange", "CoSimulation"):  # FMI 3.0 requires this order
        state = "FMUstate" if fmi == 2 else "FMUState"
        capable = [f"canGetAndSet{state}", f"canSerialize{state}"]
        if interface == "CoSimulation":
            capable.insert(0, "canHandleVariableCommunicationStepSize")
        capable += (
            ["providesDirectionalDerivative", "canNotUseMemoryManagementFunctions"]
            if fmi == 2
            else ["providesDirectionalDerivatives", "providesAdjointDerivatives"]
        )
        attributes = dict.fromkeys(capable, "true")
        add_interface(root, fmi, interface, model_identifier(model.name), attributes, sources)
    derivatives = _state_derivatives(eq, description.variables)
    names = {unit for v in derivatives.values() for unit in v.units if unit is not None}
    units = {**description.units, **{name: parse_unit(name) for name in sorted(names)}}
    add_units(root, units)
    experiment = experiment_of(model)
    add_experiment(root, experiment.stop_time, experiment.step_size, description, tolerance="1e-06")
    variables = description.variables
    state_of = {d.name: variables[x] for x, d in derivatives.items()}
    every = [*variables.values(), *derivatives.values()]
    reference = add_variables(root, fmi, every, state_of, "simulation time")
    _model_structure(root, fmi, eq, description, derivatives, reference)
    return xml_text(root)


def xml_text(root: Element) -> str:
    """Return an element as indented XML; the same content gives the same text."""
    indent(root)
    text: str = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def document(fmi: FmiVersion, name: str, token: str, description: str, tool: str) -> Element:
    """Return the root of a model description."""
    return Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0" if fmi == 2 else "3.0",
            "modelName": name,
            ("guid" if fmi == 2 else "instantiationToken"): token,
            "description": " ".join(description.split()),
            "generationTool": tool,
            "license": "Apache-2.0",
            "variableNamingConvention": "structured",
        },
    )


def add_interface(
    root: Element,
    fmi: FmiVersion,
    interface: str,
    identifier: str,
    capabilities: Mapping[str, str],
    sources: Sequence[str],
) -> None:
    """Add CoSimulation or ModelExchange; FMI 3.0 lists the sources in a file of their own."""
    element = SubElement(root, interface, {"modelIdentifier": identifier, **capabilities})
    if fmi == 2 and sources:
        files = SubElement(element, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)


def add_units(root: Element, units: Mapping[str, Unit]) -> None:
    """Add the definitions of the units."""
    element = SubElement(root, "UnitDefinitions")
    known = {**units, "s": parse_unit("s")}  # of the independent variable
    for name in sorted(known):
        unit = known[name]
        base = {b: str(e) for b, e in zip(BASE, unit.exponents, strict=True) if e}
        if unit.factor != 1.0:
            base["factor"] = number_text(unit.factor)
        if unit.offset != 0.0:
            base["offset"] = number_text(unit.offset)
        SubElement(SubElement(element, "Unit", name=name), "BaseUnit", base)


def add_experiment(
    root: Element, stop_time: float, step_size: float, d: Description, **more: str
) -> None:
    """Add the categories of log messages, and the default experiment; times in s."""
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="refused calls")
    if any(v.soft_min for v in d.variables.values()):
        words = "values below the minimum of an input"
        SubElement(categories, "Category", name="logStatusWarning", description=words)
    times = {"stopTime": number_text(stop_time), "stepSize": number_text(step_size)}
    SubElement(root, "DefaultExperiment", {"startTime": "0", **times, **more})


def _variable_attributes(v: Variable, name: str, reference: int) -> dict[str, str]:
    """Return the attributes that variables of all types have."""
    attributes = {"name": name, "valueReference": str(reference)}
    if v.description:
        attributes["description"] = " ".join(v.description.split())
    attributes |= {"causality": v.causality, "variability": v.variability}
    if v.causality != "input" and v.initial is not None:
        attributes["initial"] = v.initial
    return attributes


def _value_attributes(
    v: Variable, unit: str | None, starts: Iterable[float] | None
) -> dict[str, str]:
    """Return the attributes for unit, bounds and start."""
    if v.type == "String":
        return {"start": str(v.start)}
    attributes = {}
    if unit is not None:
        attributes["unit"] = unit
    if v.type != "Boolean":
        for key, bound in (("min", v.min), ("max", v.max)):
            if bound is not None:
                attributes[key] = str(int(bound)) if v.type == "Int32" else number_text(bound)
    if starts is not None:
        attributes["start"] = " ".join(
            ("true" if s else "false") if v.type == "Boolean"
            else str(int(s)) if v.type == "Int32"
            else number_text(float(s))
            for s in starts
        )  # fmt: skip
    return attributes


def number_text(value: float) -> str:
    """Return a number as short text that reads back to the same bits."""
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def add_variables(
    root: Element,
    fmi: FmiVersion,
    variables: Iterable[Variable],
    state_of: Mapping[str, Variable] = {},
    time_text: str = "",
) -> dict[int, str]:
    """Add the variables; return how the model structure refers to the value at each offset.

    That is by an index in FMI 2.0, by a value reference in FMI 3.0. `state_of` are the states by
    the names of their derivatives, which come after them.
    """
    parent = SubElement(root, "ModelVariables")
    reference: dict[int, str] = {}
    if fmi == 3:
        reference[0] = "0"
        text = {"description": time_text} if time_text else {}
        time = {"name": "time", "valueReference": "0", **text, "causality": "independent"}
        SubElement(parent, "Float64", {**time, "variability": "continuous", "unit": "s"})
    for v in variables:
        first = v.value_references[0]
        state = state_of[v.name].value_references[0] if v.name in state_of else None
        starts = None if v.start is None or v.type == "String" else np.ravel(v.start).tolist()
        if fmi == 2:
            for i, name in enumerate(v.element_names):
                reference[first + i] = str(len(reference) + 1)
                attributes = _variable_attributes(v, name, first + i)
                scalar = SubElement(parent, "ScalarVariable", attributes)
                start = None if starts is None else [starts[i]]
                attributes = _value_attributes(v, v.unit_of_element(i), start)
                if state is not None:
                    attributes["derivative"] = reference[state + i]
                SubElement(scalar, _FMI2_TYPES[v.type], attributes)
            continue
        reference.update(dict.fromkeys(range(first, first + v.size), str(first)))
        attributes = _variable_attributes(v, v.name, first)
        if v.type == "String":
            SubElement(SubElement(parent, "String", attributes), "Start", value=str(v.start))
            continue
        attributes |= _value_attributes(v, v.unit, starts)
        if state is not None:
            attributes["derivative"] = reference[state]
        element = SubElement(parent, v.type, attributes)
        if v.element_units:  # FMI 3.0 has one unit for the whole array
            notes = SubElement(element, "Annotations")
            note = SubElement(notes, "Annotation", type=UNITS_ANNOTATION)
            note.text = " ".join(unit or "1" for unit in v.element_units)
        for extent in v.shape:
            SubElement(element, "Dimension", start=str(extent))
    return reference


def _model_structure(
    root: Element,
    fmi: FmiVersion,
    eq: Equations,
    description: Description,
    derivatives: Mapping[str, Variable],
    reference: Mapping[int, str],
) -> None:
    def unknowns(variables: Iterable[Variable], first: int) -> list[tuple[str, range]]:
        """List references and rows; row 0 is at the offset `first`. FMI 2.0 has single elements."""
        return [
            (reference[k], range(k - first, k - first + size))
            for v in variables
            for size in (1 if fmi == 2 else v.size,)
            for k in range(v.value_references[0], v.value_references[0] + v.size, size)
        ]

    outputs = unknowns(description.of("output"), eq.layout.offset["output"])
    states = unknowns([description.variables[x] for x in derivatives], eq.layout.offset["state"])
    of_states = unknowns(derivatives.values(), eq.layout.size)
    structure = SubElement(root, "ModelStructure")
    key = "index" if fmi == 2 else "valueReference"
    rates: list[dict[int, str]] = [dict.fromkeys(k, "dependent") for k in derivative_knowns(eq)]
    for tag, group, listed, direct in (
        ("Output", "Outputs", outputs, direct_kinds(eq)),
        ("ContinuousStateDerivative", "Derivatives", of_states, rates),
    ):
        parent = SubElement(structure, group) if fmi == 2 and listed else structure
        for name, rows in listed:
            kinds: dict[str, str] = {}
            for k, kind in (item for row in rows for item in direct[row].items()):
                if k in reference:  # else the variable is not exposed
                    known = reference[k]
                    kinds[known] = max(kinds.get(known, kind), kind, key=KINDS.index)
            depends = {
                "dependencies": " ".join(kinds),
                "dependenciesKind": " ".join(kinds.values()),
            }
            SubElement(parent, "Unknown" if fmi == 2 else tag, {key: name, **depends})
    initial: list[tuple[str, list[str]]] = []
    for listed, knowns in (
        (outputs, initial_knowns(eq)),
        (states, initial_knowns(eq, "initial")),
        (of_states, initial_knowns(eq, "rhs")),
    ):
        for name, rows in listed:
            names = {reference[k] for row in rows for k in knowns[row] if k in reference}
            initial.append((name, sorted(names, key=int)))
    parent = structure
    if fmi == 2 and initial:
        initial.sort(key=lambda u: int(u[0]))  # FMI 2.0 requires this order
        parent = SubElement(structure, "InitialUnknowns")
    for name, depends_on in initial:
        attributes = {key: name, "dependencies": " ".join(depends_on)}
        SubElement(parent, "Unknown" if fmi == 2 else "InitialUnknown", attributes)


def _state_derivatives(eq: Equations, states: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return ``der(x)`` for each continuous state, by the state's name; `Layout` places them."""
    found: dict[str, Variable] = {}
    for p in eq.layout.placed:
        if p.variable.kind == "state":
            v = states[p.variable.name]
            found[v.name] = Variable(
                name=f"der({v.name})",
                type="Float64",
                causality="local",
                variability="continuous",
                shape=v.shape,
                unit=None if v.unit is None else _rate(v.unit),
                description=f"derivative of {v.name}",
                initial="calculated",
                value_references=(eq.layout.derivative_of(p),),
                element_units=tuple(None if u is None else _rate(u) for u in v.element_units),
            )
    return found


def _rate(unit: str) -> str:
    """Return a unit divided by a second: ``m/s`` becomes ``m/s2``."""
    found = _PER_TIME.search(unit)
    if found is None:
        return f"{unit}/s"
    return f"{unit[: found.start()]}/s{int(found[1] or 1) + 1}"
