"""Export of a declaration's modelDescription.xml for FMI 2.0 or FMI 3.0."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
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
    "Places",
    "model_description",
    "model_identifier",
    "model_structure",
    "rate_units",
    "state_derivatives",
    "xml_text",
]

_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9]*(\.[A-Za-z_][A-Za-z_0-9]*)*$")
_FMI2_TYPES = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}


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
    for name in description.variables:
        if name == "time" or _NAME.match(name) is None:
            raise ParameterInvalid(
                description.name,
                f"variable {name!r} cannot be exported",
                "a name of letters, digits, '_' and '.', other than 'time'",
            )
    tool = f"uuvsim-cosim {__version__}" if release else "uuvsim-cosim"
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0" if fmi == 2 else "3.0",
            "modelName": model.name,
            ("guid" if fmi == 2 else "instantiationToken"): token,
            "description": " ".join(model.description.split()),
            "generationTool": tool,
            "license": "Apache-2.0",
            "variableNamingConvention": "structured",
        },
    )
    for interface in ("ModelExchange", "CoSimulation"):  # FMI 3.0 requires this order
        _interface(root, fmi, interface, model_identifier(model.name), sources)
    derivatives = state_derivatives(eq, description.variables)
    _units(root, replace(description, units={**description.units, **rate_units(derivatives)}))
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="refused calls")
    experiment = experiment_of(model)
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=_number(experiment.stop_time),
        stepSize=_number(experiment.step_size),
        tolerance="1e-06",
    )
    variables = _fmi2_variables if fmi == 2 else _fmi3_variables
    model_structure(root, fmi, eq, variables(root, description, derivatives))
    return xml_text(root)


def xml_text(root: Element) -> str:
    """Return an element as indented XML; the same content gives the same text."""
    indent(root)
    text: str = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _interface(
    root: Element, fmi: FmiVersion, interface: str, identifier: str, sources: Sequence[str]
) -> None:
    capabilities = {
        2: "canGetAndSetFMUstate canSerializeFMUstate providesDirectionalDerivative "
        "canNotUseMemoryManagementFunctions",
        3: "canGetAndSetFMUState canSerializeFMUState providesDirectionalDerivatives "
        "providesAdjointDerivatives",
    }[fmi].split()
    names = [*capabilities]
    if interface == "CoSimulation":
        names.insert(0, "canHandleVariableCommunicationStepSize")
    attributes = {"modelIdentifier": identifier, **dict.fromkeys(names, "true")}
    element = SubElement(root, interface, attributes)
    if fmi == 2 and sources:
        files = SubElement(element, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)


def _units(root: Element, description: Description) -> None:
    units = SubElement(root, "UnitDefinitions")
    known = {**description.units, "s": parse_unit("s")}  # of the independent variable
    for name in sorted(known):
        unit = known[name]
        base = {b: str(e) for b, e in zip(BASE, unit.exponents, strict=True) if e}
        if unit.factor != 1.0:
            base["factor"] = _number(unit.factor)
        if unit.offset != 0.0:
            base["offset"] = _number(unit.offset)
        SubElement(SubElement(units, "Unit", name=name), "BaseUnit", base)


def _common(v: Variable, name: str, reference: int) -> dict[str, str]:
    attributes = {"name": name, "valueReference": str(reference)}
    if v.description:
        attributes["description"] = " ".join(v.description.split())
    attributes |= {"causality": v.causality, "variability": v.variability}
    if v.causality != "input" and v.initial is not None:
        attributes["initial"] = v.initial
    return attributes


def _value(v: Variable, unit: str | None, starts: Iterable[float] | None) -> dict[str, str]:
    """Return the attributes for unit, bounds and start."""
    attributes = {}
    if unit is not None:
        attributes["unit"] = unit
    if v.type != "Boolean":
        for key, bound in (("min", v.min), ("max", v.max)):
            if bound is not None:
                attributes[key] = str(int(bound)) if v.type == "Int32" else _number(bound)
    if starts is not None:
        attributes["start"] = " ".join(
            ("true" if s else "false") if v.type == "Boolean"
            else str(int(s)) if v.type == "Int32"
            else _number(float(s))
            for s in starts
        )  # fmt: skip
    return attributes


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _fmi2_variables(
    root: Element, description: Description, derivatives: Mapping[str, Variable]
) -> Places:
    parent = SubElement(root, "ModelVariables")
    index: dict[int, str] = {}
    outputs: list[tuple[str, range]] = []
    state_of = {d.name: description.variables[x] for x, d in derivatives.items()}
    for v in [*description.variables.values(), *derivatives.values()]:
        first = v.value_references[0]
        starts = None if v.start is None else np.ravel(v.start)
        for i, name in enumerate(v.element_names):
            index[first + i] = str(len(index) + 1)
            element = SubElement(parent, "ScalarVariable", _common(v, name, first + i))
            start = None if starts is None else [starts[i]]
            real = SubElement(element, _FMI2_TYPES[v.type], _value(v, v.unit_of_element(i), start))
            if v.name in state_of:
                real.set("derivative", index[state_of[v.name].value_references[0] + i])
            if v.causality == "output":
                outputs.append((index[first + i], range(first + i, first + i + 1)))
    pairs = [
        (index[x.value_references[0] + i], index[d.value_references[0] + i])
        for d, x in ((d, description.variables[name]) for name, d in derivatives.items())
        for i in range(x.size)
    ]
    numbers = [range(k, k + 1) for k in range(len(pairs))]
    return Places(
        index.get,
        outputs,
        [(x, n) for (x, _), n in zip(pairs, numbers, strict=True)],
        [(d, n) for (_, d), n in zip(pairs, numbers, strict=True)],
    )


def _fmi3_variables(
    root: Element, description: Description, derivatives: Mapping[str, Variable]
) -> Places:
    parent = SubElement(root, "ModelVariables")
    reference: dict[int, str] = {0: "0"}
    outputs: list[tuple[str, range]] = []
    SubElement(
        parent,
        "Float64",
        name="time",
        valueReference="0",
        description="simulation time",
        causality="independent",
        variability="continuous",
        unit="s",
    )
    state_of = {d.name: description.variables[x] for x, d in derivatives.items()}
    states: list[tuple[str, range]] = []
    rates: list[tuple[str, range]] = []
    k = 0
    for v in [*description.variables.values(), *derivatives.values()]:
        first = v.value_references[0]
        starts = None if v.start is None else np.ravel(v.start)
        attributes = {**_common(v, v.name, first), **_value(v, v.unit, starts)}
        if v.name in state_of:
            state = str(state_of[v.name].value_references[0])
            attributes["derivative"] = state
            states.append((state, range(k, k + v.size)))
            rates.append((str(first), range(k, k + v.size)))
            k += v.size
        element = SubElement(parent, v.type, attributes)
        if v.element_units:  # FMI 3.0 has one unit for the whole array
            notes = SubElement(element, "Annotations")
            note = SubElement(notes, "Annotation", type=UNITS_ANNOTATION)
            note.text = " ".join(unit or "1" for unit in v.element_units)
        for extent in v.shape:
            SubElement(element, "Dimension", start=str(extent))
        reference.update(dict.fromkeys(range(first, first + v.size), str(first)))
        if v.causality == "output":
            outputs.append((str(first), range(first, first + v.size)))
    return Places(reference.get, outputs, states, rates)


FmiVersion = Literal[2, 3]


@dataclass(frozen=True)
class Places:
    """References in XML to offsets of the block: by index (FMI 2) or value reference (FMI 3)."""

    reference: Callable[[int], str | None]  # None: the variable is not exposed
    outputs: list[tuple[str, range]]  # reference and elements of each output
    states: list[tuple[str, range]]  # and of each continuous state
    derivatives: list[tuple[str, range]]  # the same elements, as references to derivatives


def model_structure(root: Element, fmi: FmiVersion, eq: Equations, places: Places) -> None:
    """Add the element ModelStructure to `root`."""
    structure = SubElement(root, "ModelStructure")
    direct = direct_kinds(eq)
    first = eq.layout.offset["output"]
    of_rates: list[dict[int, str]] = [dict.fromkeys(k, "dependent") for k in derivative_knowns(eq)]
    by_row = [
        ("Output", [(name, [direct[r - first] for r in rows]) for name, rows in places.outputs]),
        (
            "ContinuousStateDerivative",
            [(name, [of_rates[r] for r in rows]) for name, rows in places.derivatives],
        ),
    ]
    for tag, unknowns in by_row:
        parent = structure
        if fmi == 2 and unknowns:
            parent = SubElement(structure, "Outputs" if tag == "Output" else "Derivatives")
        for name, found in unknowns:
            kinds: dict[str, str] = {}
            for place, kind in (item for row in found for item in row.items()):
                known = places.reference(place)
                if known is not None:
                    kinds[known] = max(kinds.get(known, kind), kind, key=KINDS.index)
            attributes = {
                "index" if fmi == 2 else "valueReference": name,
                "dependencies": " ".join(kinds),
                "dependenciesKind": " ".join(kinds.values()),
            }
            SubElement(parent, "Unknown" if fmi == 2 else tag, attributes)
    _initial_unknowns(structure, fmi, eq, places)


def _initial_unknowns(structure: Element, fmi: FmiVersion, eq: Equations, places: Places) -> None:
    unknowns: list[tuple[str, list[str]]] = []
    for listed, rows in (
        (places.outputs, dict(enumerate(initial_knowns(eq), eq.layout.offset["output"]))),
        (places.states, dict(enumerate(initial_knowns(eq, "initial")))),
        (places.derivatives, dict(enumerate(initial_knowns(eq, "rhs")))),
    ):
        for name, elements in listed:
            found = {places.reference(place) for row in elements for place in rows[row]}
            unknowns.append((name, sorted((k for k in found if k is not None), key=int)))
    parent = structure
    if fmi == 2:
        unknowns.sort(key=lambda u: int(u[0]))  # FMI 2.0 requires this order
        parent = SubElement(structure, "InitialUnknowns") if unknowns else structure
    for name, knowns in unknowns:
        SubElement(
            parent,
            "Unknown" if fmi == 2 else "InitialUnknown",
            {
                "index" if fmi == 2 else "valueReference": name,
                "dependencies": " ".join(knowns),
            },
        )


_PER_TIME = re.compile(r"/s(\d*)$")


def state_derivatives(eq: Equations, states: Mapping[str, Variable]) -> dict[str, Variable]:
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


def rate_units(derivatives: Mapping[str, Variable]) -> dict[str, Unit]:
    """Return the units of the derivatives by name."""
    names = {unit for v in derivatives.values() for unit in v.units}
    return {name: parse_unit(name) for name in sorted(n for n in names if n is not None)}


def _rate(unit: str) -> str:
    """Return a unit divided by a second: ``m/s`` becomes ``m/s2``."""
    found = _PER_TIME.search(unit)
    if found is None:
        return f"{unit}/s"
    return f"{unit[: found.start()]}/s{int(found[1] or 1) + 1}"
