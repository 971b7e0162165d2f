"""Parameter sets (.ssv): values by name, with types, units and, in SSP 2.0, dimensions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.models.declaration.element_names import index_text
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.units import Unit
from uuvsim_cosim.orchestrator.parameters.ssp_xml import (
    SspVersion,
    add_units,
    document,
    has_arrays,
    q,
    read_document,
    read_units,
    type_name,
)
from uuvsim_cosim.orchestrator.values.values import flat, is_float
from uuvsim_cosim.orchestrator.values.xml_values import (
    BOOLEANS,
    int_of,
    local_name,
    number,
    text_of,
)

__all__ = ["EnumerationItem", "Enumerations", "ParameterValue", "parameter_set",
           "read_enumerations", "read_parameter_set", "read_ssv", "write_ssv"]  # fmt: skip

Enumerations = Mapping[str, Mapping[str, int]]
# Values by the type of a parameter's element; those of any other type are integers.
_READ: dict[str, Callable[[str], Any]] = {
    "Real": float, "Float64": float, "Float32": float, "Binary": bytes.fromhex, "String": str,
    "Boolean": lambda text: BOOLEANS[text.strip()],
}  # fmt: skip


@dataclass(frozen=True)
class ParameterValue:
    """Parameter of a file: its value and its unit.

    The value is a scalar or a flat list, row by row; a `Quantity` once its unit is looked up.
    """

    name: str
    value: object
    unit: str | None = None


def write_ssv(
    start: Mapping[str, object], description: Description, path: Path, version: SspVersion = "2.0"
) -> None:
    """Write values of a component's variables into a separate file."""
    root = parameter_set(start.items(), description, version, path.stem)
    variables = [description.variables[name] for name in start]
    names = {u for v in variables if is_float(v) for u in v.units if u}
    add_units(root, names, description.units, "ssv:Units")
    path.write_bytes(document(root, "ssc", "ssv"))


def read_ssv(path: Path) -> tuple[list[ParameterValue], dict[str, Unit]]:
    """Read a file of values, with the units that it defines."""
    place = shown(path)
    root = read_document(path, "ssv:ParameterSet")
    return read_parameter_set(root, place), read_units(root, "ssv:Units", place)


def parameter_set(
    start: Iterable[tuple[str, object]], description: Description, version: SspVersion, name: str
) -> Element:
    """Return the element ``ssv:ParameterSet`` for fitted values, without its units."""
    arrays = has_arrays(description, version)
    root = Element("ssv:ParameterSet", version=version, name=name)
    parameters = SubElement(root, "ssv:Parameters")
    for key, value in start:
        variable = description.variables[key]
        if arrays:
            _add(parameters, key, variable, flat(value), version, variable.shape, variable.unit)
            continue
        for i, element in enumerate(flat(value)):
            name, unit = f"{key}{index_text(variable.shape, i)}", variable.unit_of_element(i)
            _add(parameters, name, variable, [element], version, (), unit)
    return root


def _add(
    parent: Element,
    name: str,
    variable: Variable,
    values: list[Any],
    version: SspVersion,
    shape: tuple[int, ...],
    unit: str | None,
) -> None:
    parameter = SubElement(parent, "ssv:Parameter", name=name)
    typed = SubElement(parameter, f"ssv:{type_name(variable.type, version)}")
    if variable.type in ("String", "Binary") and len(values) > 1:
        for value in values:
            SubElement(typed, "ssv:Value", value=_text(variable, value))
    else:
        typed.set("value", " ".join(_text(variable, v) for v in values))
    if unit and is_float(variable):
        typed.set("unit", unit)
    for extent in shape:
        SubElement(parameter, "ssc:Dimension", size=str(extent))


def _text(variable: Variable, value: Any) -> str:
    if variable.type == "Binary":
        return bytes(value).hex()
    return number(value) if is_float(variable) else text_of(value)


def read_parameter_set(
    root: Element, place: str, enumerations: Enumerations | None = None
) -> list[ParameterValue]:
    """Read the element ``ssv:ParameterSet``; `enumerations` are those of the file around it."""
    enumerations = {**(enumerations or {}), **read_enumerations(root, "ssv:Enumerations", place)}
    found: list[ParameterValue] = []
    for parameter in root.iterfind(f"{q('ssv:Parameters')}/{q('ssv:Parameter')}"):
        name = parameter.get("name", "")
        here = f"{place}: parameter {name!r}"
        children = [(local_name(e), e) for e in parameter]
        shape = [int_of(e, "size", here, 0) for tag, e in children if tag == "Dimension"]
        others = [c for c in children if c[0] not in ("Dimension", "Annotations")]
        if not others:
            raise InputInvalid(place, f"parameter {name!r} has no value", "<ssv:Real …>")
        tag, typed = others[0]
        texts = [e.get("value", "") for e in typed if local_name(e) == "Value"]
        if not texts:
            text = typed.get("value", "")
            texts = text.split() if shape and tag not in ("String", "Binary") else [text]
        try:
            if tag == "Enumeration":
                values = [_item(typed, t, enumerations, here) for t in texts]
            else:
                values = [_READ.get(tag, int)(t) for t in texts]
        except (ValueError, KeyError):
            raise InputInvalid(
                place,
                f"parameter {name!r} is {typed.get('value')!r}",
                f"a value of type {tag}",
            ) from None
        value = values if shape else values[0]
        found.append(ParameterValue(name, value, typed.get("unit")))
    return found


def read_enumerations(parent: Element, tag: str, place: str) -> Enumerations:
    """Read the enumerations that a file defines: the numbers of their items, by name."""
    return {
        item.get("name", ""): {
            i.get("name", ""): int_of(i, "value", f"{place}: <{local_name(item)}>", 0)
            for i in item.iterfind(q("ssc:Item"))
        }
        for item in parent.iterfind(f"{q(tag)}/{q('ssc:Enumeration')}")
    }


class EnumerationItem(int):
    """Number of an enumeration's item, with the item's name (for mappings of names)."""

    item: str = ""


def _item(typed: Element, text: str, enumerations: Enumerations, place: str) -> int | str:
    """Return the number of an enumeration's item, or its name if the file defines none.

    The variable's own enumeration then gives the number (`values.fit`).
    """
    if text.strip().lstrip("-").isdecimal():
        return int(text)
    if not enumerations:
        return text
    name = typed.get("name")
    if name is not None and name not in enumerations:
        raise InputInvalid(
            place,
            f"enumeration {name!r}",
            expected_names(name, list(enumerations), "one that the file defines"),
        )
    known = [enumerations[name]] if name is not None else list(enumerations.values())
    numbers = {items[text] for items in known if text in items}
    if len(numbers) != 1:
        names = [i for items in known for i in items]
        raise InputInvalid(
            place,
            f"{text!r} is the item of {len(numbers)} enumerations of the file",
            f"{expected_names(text, names, 'an item')}, or a whole number",
        )
    found = EnumerationItem(numbers.pop())
    found.item = text
    return found
