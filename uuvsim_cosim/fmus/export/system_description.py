"""The modelDescription.xml and the page of a component that is a whole system."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.fmus.description import UNITS_ANNOTATION, Description, Variable
from uuvsim_cosim.fmus.export.model_description import (
    FmiVersion,
    _common,
    _number,
    _units,
    _value,
    xml_text,
)

__all__ = ["Whole", "component_table", "index_page", "whole_description"]

_FMI2_TYPES = {"Float64": "Real", "Int32": "Integer", "Boolean": "Boolean", "String": "String"}


@dataclass(frozen=True)
class Whole:
    """The description of a whole system's FMU; value references are offsets in its block."""

    identifier: str
    description: Description
    token: str
    tick: Fraction  # s
    stop_time: float  # s
    states: bool  # its state can be saved
    needs_tool: bool  # it needs another program

    @property
    def size(self) -> int:
        """The number of values of the block; texts follow it."""
        variables = [v for v in self.description.variables.values() if v.type != "String"]
        last = max(variables, key=lambda v: v.value_references[0])
        return last.value_references[0] + last.size


def whole_description(w: Whole, fmi: FmiVersion, sources: Sequence[str] = ()) -> str:
    """Return the XML text of FMI 2.0 or FMI 3.0.

    An output at a communication point results from the last step, so that it depends on no input;
    in initialization it may depend on all.
    """
    d = w.description
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0" if fmi == 2 else "3.0",
            "modelName": d.name,
            ("guid" if fmi == 2 else "instantiationToken"): w.token,
            "description": " ".join(d.description.split()),
            "generationTool": f"uuvsim-cosim {__version__}",
            "license": "Apache-2.0",
            "variableNamingConvention": "structured",
        },
    )
    _co_simulation(root, w, fmi, sources)
    _units(root, d)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="refused calls")
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=_number(w.stop_time),
        stepSize=_number(float(w.tick)),
    )
    _variables_and_structure(root, d, fmi)
    return xml_text(root)


def _co_simulation(root: Element, w: Whole, fmi: FmiVersion, sources: Sequence[str]) -> None:
    attributes = {"modelIdentifier": w.identifier}
    if w.needs_tool:
        attributes["needsExecutionTool"] = "true"
        # Two instances would control the same co-simulation.
        attributes["canBeInstantiatedOnlyOncePerProcess"] = "true"
    if w.states:
        state = "FMUstate" if fmi == 2 else "FMUState"
        attributes |= {f"canGetAndSet{state}": "true", f"canSerialize{state}": "true"}
    if fmi == 2:
        attributes["canNotUseMemoryManagementFunctions"] = "true"
    else:
        attributes["fixedInternalStepSize"] = _number(float(w.tick))
    element = SubElement(root, "CoSimulation", attributes)
    if fmi == 2 and sources:
        files = SubElement(element, "SourceFiles")
        for name in sources:
            SubElement(files, "File", name=name)


def _variables_and_structure(root: Element, d: Description, fmi: FmiVersion) -> None:
    parent = SubElement(root, "ModelVariables")
    outputs: list[str] = []
    if fmi == 3:
        time = {"name": "time", "valueReference": "0", "causality": "independent"}
        SubElement(parent, "Float64", {**time, "variability": "continuous", "unit": "s"})
    index = 0
    for v in d.variables.values():
        first = v.value_references[0]
        if fmi == 3:
            _fmi3_variable(parent, v)
            if v.causality == "output":
                outputs.append(str(first))
            continue
        starts = None if v.start is None or v.type == "String" else np.ravel(v.start).tolist()
        for i, name in enumerate(v.element_names):
            index += 1
            start = None if starts is None else [starts[i]]
            scalar = SubElement(parent, "ScalarVariable", _common(v, name, first + i))
            values = {"start": str(v.start)}
            if v.type != "String":
                values = _value(v, v.unit_of_element(i), start)
            SubElement(scalar, _FMI2_TYPES[v.type], values)
            if v.causality == "output":
                outputs.append(str(index))
    structure = SubElement(root, "ModelStructure")
    key = "index" if fmi == 2 else "valueReference"
    for tag, more in (("Output", {"dependencies": ""}), ("InitialUnknown", {})):
        inside = SubElement(structure, f"{tag}s") if fmi == 2 and outputs else structure
        for known_as in outputs:
            SubElement(inside, "Unknown" if fmi == 2 else tag, {key: known_as, **more})


def _fmi3_variable(parent: Element, v: Variable) -> None:
    common = _common(v, v.name, v.value_references[0])
    if v.type == "String":
        SubElement(SubElement(parent, "String", common), "Start", value=str(v.start))
        return
    starts = None if v.start is None else np.ravel(v.start).tolist()
    element = SubElement(parent, v.type, {**common, **_value(v, v.unit, starts)})
    if v.element_units:  # FMI 3.0 has one unit for the whole array
        note = SubElement(SubElement(element, "Annotations"), "Annotation", type=UNITS_ANNOTATION)
        note.text = " ".join(unit or "1" for unit in v.element_units)
    for extent in v.shape:
        SubElement(element, "Dimension", start=str(extent))


def component_table(w: Whole) -> str:
    """Return the C of the table that the shells read: names, kinds, bounds, start values."""
    numeric = [v for v in w.description.variables.values() if v.type != "String"]
    first = min((v.value_references[0] for v in numeric if v.causality == "output"), default=w.size)
    start = np.zeros(w.size)
    inputs = sum(v.size for v in numeric if v.causality == "input")  # they come first
    rows = []
    for v in numeric:
        at = v.value_references[0]
        if v.start is not None:
            start[at : at + v.size] = np.ravel(v.start)
        kind = {"input": "UUV_INPUT", "output": "UUV_OUTPUT"}.get(
            v.causality, "UUV_TUNABLE" if v.variability == "tunable" else "UUV_FIXED"
        )
        rows.append(
            f'    {{"{v.name}", {at}, {v.size}, UUV_{v.type.upper()}, {kind}, '
            f"{1 if v.shape else 0}, {_bound(v.min, '-')}, {_bound(v.max, '')}}},"
        )
    numbers = ", ".join(float(x).hex() for x in start)
    lines = [
        f"static const double block_start[] = {{{numbers}}};",
        "static const uuv_variable block_variables[] = {",
        '    {"time", 0, 1, UUV_FLOAT64, UUV_TIME, 0, -__builtin_inf(), __builtin_inf()},',
        *rows,
        "};",
        "const uuv_component uuv_the_component = {",
        f'    .name = "{w.identifier}", .token = "{w.token}", .n_block = {w.size},',
        f"    .off_x = {first}, .off_y = {first}, .n_y = {w.size - first},",
        f"    .off_u = 1, .n_u = {inputs}, .off_seed = -1,",
        "    .start = block_start, .variables = block_variables,",
        f"    .n_variables = {len(rows) + 1},",
        "};",
    ]
    return "\n".join(lines) + "\n"


def _bound(value: float | None, sign: str) -> str:
    return f"{sign}__builtin_inf()" if value is None else float(value).hex()


def index_page(w: Whole, text: str) -> str:
    """Return the page that FMI tools show: a text, then the variables."""
    rows = []
    for v in w.description.variables.values():
        shape = f"[{', '.join(map(str, v.shape))}]" if v.shape else ""
        cells = (v.name + shape, v.type, v.causality, v.variability, v.unit_text, v.description)
        rows.append("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in cells) + "</tr>")
    columns = ("name", "type", "causality", "variability", "unit", "meaning")
    head = "".join(f"<th>{c}</th>" for c in columns)
    name = html.escape(w.description.name)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{name}</title>'
        "</head>\n<body>\n"
        f"<h1>{name}</h1>\n<p>{html.escape(text)}</p>\n<table>\n<tr>{head}</tr>\n"
        + "\n".join(rows)
        + "\n</table>\n</body>\n</html>\n"
    )
