"""A declaration becomes a modelDescription.xml of FMI 2.0 or FMI 3.0."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.fmus.dependencies import KINDS, direct_kinds, initial_knowns
from uuvsim_cosim.fmus.describe import describe
from uuvsim_cosim.fmus.description import UNITS_ANNOTATION, Description, Variable
from uuvsim_cosim.fmus.equations import Equations
from uuvsim_cosim.fmus.experiment import experiment_of
from uuvsim_cosim.models.units import BASE, parse_unit

__all__ = [
    "FmiVersion",
    "element_names",
    "model_description",
    "model_identifier",
    "xml_text",
]

FmiVersion = Literal[2, 3]
_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9]*(\.[A-Za-z_][A-Za-z_0-9]*)*$")
_FMI2_TYPES = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean"}


def model_identifier(name: str) -> str:
    """Give the name as FMI needs it: a C identifier, which is also the binary's name."""
    identifier = re.sub(r"\W", "_", name, flags=re.ASCII)
    return identifier if re.match(r"[A-Za-z_]", identifier) else f"_{identifier}"


def element_names(v: Variable) -> list[str]:
    """Give the names of a variable's elements: ``tau[1]``, ``M[1,2]``; a scalar's own name."""
    if not v.shape:
        return [v.name]
    indices = product(*(range(1, extent + 1) for extent in v.shape))
    return [f"{v.name}[{','.join(map(str, i))}]" for i in indices]


def model_description(
    eq: Equations, *, fmi: FmiVersion, token: str, sources: Sequence[str] = (), release: bool = True
) -> str:
    """Give the XML text; `sources` are listed in FMI 2.0, and the tool's version in a release."""
    model = eq.layout.model
    description = describe(model, eq)
    _refuse_names(description)
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
    _co_simulation(root, fmi, model_identifier(model.name), sources)
    _units(root, description)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="refused calls")
    experiment = experiment_of(model)
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=_number(experiment.stop_time),
        stepSize=_number(experiment.step_size),
    )
    places = _fmi2_variables(root, description) if fmi == 2 else _fmi3_variables(root, description)
    _model_structure(root, fmi, eq, places)
    return xml_text(root)


def xml_text(root: Element) -> str:
    """Write an element as indented XML, the same for the same content."""
    indent(root)
    text: str = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


@dataclass(frozen=True)
class _Places:
    """How XML refers to a place of the block: by index (FMI 2) or value reference (FMI 3)."""

    reference: Callable[[int], str | None]  # None: the place is not exposed
    outputs: list[tuple[str, range]]  # reference and elements of each output


def _refuse_names(description: Description) -> None:
    for v in description.variables.values():
        if v.name == "time" or _NAME.match(v.name) is None:
            raise ParameterInvalid(
                f"{description.name}: variable {v.name!r} cannot be exported; expected a name of "
                "letters, digits, '_' and '.', other than 'time'"
            )


def _co_simulation(root: Element, fmi: FmiVersion, identifier: str, sources: Sequence[str]) -> None:
    capabilities = {
        2: "canGetAndSetFMUstate canSerializeFMUstate providesDirectionalDerivative "
        "canNotUseMemoryManagementFunctions",
        3: "canGetAndSetFMUState canSerializeFMUState providesDirectionalDerivatives "
        "providesAdjointDerivatives",
    }[fmi].split()
    names = ["canHandleVariableCommunicationStepSize", *capabilities]
    attributes = {"modelIdentifier": identifier, **dict.fromkeys(names, "true")}
    element = SubElement(root, "CoSimulation", attributes)
    if fmi == 2 and sources:
        files = SubElement(element, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)


def _units(root: Element, description: Description) -> None:
    units = SubElement(root, "UnitDefinitions")
    known = {**description.units, "s": parse_unit("s")}  # time has a unit, too
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


def _value(v: Variable, unit: str | None, starts: Iterable[Any] | None) -> dict[str, str]:
    attributes = {}
    if unit is not None:
        attributes["unit"] = unit
    if v.type != "Boolean":
        for key, bound in (("min", v.min), ("max", v.max)):
            if bound is not None:
                attributes[key] = str(int(bound)) if v.type == "Int32" else _number(bound)
    if starts is not None:
        attributes["start"] = " ".join(_start(v, s) for s in starts)
    return attributes


def _start(v: Variable, value: Any) -> str:
    if v.type == "Boolean":
        return "true" if value else "false"
    return str(int(value)) if v.type == "Int32" else _number(float(value))


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def _fmi2_variables(root: Element, description: Description) -> _Places:
    parent = SubElement(root, "ModelVariables")
    index: dict[int, str] = {}
    outputs: list[tuple[str, range]] = []
    for v in description.variables.values():
        first = v.value_references[0]
        starts = None if v.start is None else np.ravel(v.start)
        for i, name in enumerate(element_names(v)):
            index[first + i] = str(len(index) + 1)
            element = SubElement(parent, "ScalarVariable", _common(v, name, first + i))
            start = None if starts is None else [starts[i]]
            SubElement(element, _FMI2_TYPES[v.type], _value(v, v.unit_of_element(i), start))
            if v.causality == "output":
                outputs.append((index[first + i], range(first + i, first + i + 1)))
    return _Places(index.get, outputs)


def _fmi3_variables(root: Element, description: Description) -> _Places:
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
    for v in description.variables.values():
        first = v.value_references[0]
        starts = None if v.start is None else np.ravel(v.start)
        attributes = {**_common(v, v.name, first), **_value(v, v.unit, starts)}
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
    return _Places(reference.get, outputs)


def _model_structure(root: Element, fmi: FmiVersion, eq: Equations, places: _Places) -> None:
    structure = SubElement(root, "ModelStructure")
    direct, initial = direct_kinds(eq), initial_knowns(eq)
    first = eq.layout.offset["output"]
    key = "index" if fmi == 2 else "valueReference"
    parent = SubElement(structure, "Outputs") if fmi == 2 and places.outputs else structure
    for name, elements in places.outputs:
        kinds: dict[str, str] = {}
        for row in elements:
            for place, kind in direct[row - first].items():
                known = places.reference(place)
                if known is not None:
                    kinds[known] = max(kinds.get(known, kind), kind, key=KINDS.index)
        SubElement(
            parent,
            "Unknown" if fmi == 2 else "Output",
            {
                key: name,
                "dependencies": " ".join(kinds),
                "dependenciesKind": " ".join(kinds.values()),
            },
        )
    parent = SubElement(structure, "InitialUnknowns") if fmi == 2 and places.outputs else structure
    for name, elements in places.outputs:
        found = {places.reference(place) for row in elements for place in initial[row - first]}
        knowns = sorted((k for k in found if k is not None), key=int)
        SubElement(
            parent,
            "Unknown" if fmi == 2 else "InitialUnknown",
            {key: name, "dependencies": " ".join(knowns)},
        )
