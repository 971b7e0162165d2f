"""Reader of the variables of an FMI 2.0 model description, with scalars folded into arrays."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from xml.etree.ElementTree import Element

import numpy as np

from uuvsim_cosim.fmus.description import Variable, VariableType
from uuvsim_cosim.fmus.description_xml import DTYPES, SimpleType, Source
from uuvsim_cosim.models.declaration.element_names import split_element_name

__all__ = ["TYPES", "fold", "read_variables_fmi2"]

TYPES: Mapping[str, VariableType] = {
    "Real": "Float64",
    "Integer": "Int32",
    "Boolean": "Boolean",
    "String": "String",
    "Enumeration": "Enumeration",
}


def read_variables_fmi2(
    source: Source, root: Element
) -> tuple[dict[str, Variable], dict[str, Mapping[int, str]]]:
    """Return the variables by name, and the items of those that are enumerations."""
    types: dict[str, SimpleType] = {}
    for e in root.iterfind("TypeDefinitions/SimpleType"):
        name, inner = source.required(e, "name", "a type"), next(iter(e), None)
        types[name] = SimpleType({}, {})
        if inner is not None:
            items = source.items(inner, f"type {name!r}")
            types[name] = SimpleType(dict(inner.attrib), items)
    scalars: list[Variable] = []
    enumerations: dict[str, Mapping[int, str]] = {}
    for element in root.iterfind("ModelVariables/ScalarVariable"):
        name = source.required(element, "name", "a variable")
        where = f"variable {name!r}"
        inner = next((e for e in element if e.tag in TYPES), None)
        if inner is None:
            raise source.fault(where, "no type", f"one of {', '.join(TYPES)}")
        declared, attributes = source.declared(inner, types, where)
        type_, start = TYPES[inner.tag], attributes.get("start")
        scalar = source.variable(
            element,
            attributes,
            type_,
            where,
            start=None if start is None else source.value(type_, start, where),
            description=element.get("description", ""),
        )
        scalars.append(scalar)
        if scalar.type == "Enumeration" and declared is not None:
            enumerations[scalar.name] = declared.items
    known = dict(enumerate(scalars, 1))
    path, expected = "ModelStructure/Outputs/Unknown", f"1 to {len(scalars)}, as of a variable"
    outputs = source.dependencies(root, path, "index", known, "index", expected)
    for index, names in outputs.items():
        scalars[index - 1] = replace(scalars[index - 1], dependencies=names)
    names_seen: set[str] = set()
    for scalar in scalars:
        if scalar.name in names_seen:
            raise source.fault(f"variable {scalar.name!r}", "declared twice", "unique names")
        names_seen.add(scalar.name)
    return fold(scalars), enumerations


def fold(scalars: Sequence[Variable]) -> dict[str, Variable]:
    """Return variables by name, in the order of their first elements.

    A group is folded if its indices run from 1 to n without a gap (row by row for matrices),
    if all its elements have the same type, causality, variability and sign, and if no scalar has
    its name; otherwise its elements stay scalars. Units of elements may differ. Dependencies are
    renamed to those of the arrays.
    """
    groups: dict[str, dict[tuple[int, ...], Variable]] = {}
    for scalar in scalars:
        name, indices = split_element_name(scalar.name)
        if indices:
            groups.setdefault(name, {})[indices] = scalar
    folded_name = {v.name: v.name for v in scalars}
    arrays: dict[str, Variable] = {}
    scalar_names = set(folded_name)
    for name, elements in groups.items():
        shape = tuple(max(axis) for axis in zip(*elements, strict=False))
        complete = (
            len({len(indices) for indices in elements}) == 1
            and math.prod(shape) == len(elements)
            and min(min(indices) for indices in elements) == 1
        )
        kinds = {(v.type, v.causality, v.variability, v.negated) for v in elements.values()}
        alike = len(kinds) == 1
        if name not in scalar_names and complete and alike:
            arrays[name] = _array(name, shape, elements)
            folded_name.update({v.name: name for v in elements.values()})
    result: dict[str, Variable] = {}
    for scalar in scalars:
        name = folded_name[scalar.name]
        result.setdefault(name, arrays.get(name, scalar))
    for name, v in result.items():
        if v.dependencies:
            names = tuple(dict.fromkeys(folded_name[d] for d in v.dependencies))
            result[name] = replace(v, dependencies=names)
    return result


def _array(
    name: str, shape: tuple[int, ...], elements: dict[tuple[int, ...], Variable]
) -> Variable:
    """Return the array of scalars by index."""
    ordered = [elements[i] for i in product(*(range(1, n + 1) for n in shape))]
    first = ordered[0]
    starts = [v.start for v in ordered]
    start = None
    if None not in starts:
        flat = np.empty(len(starts), dtype=DTYPES[first.type])
        flat[:] = starts
        start = flat.reshape(shape)
    lows = [v.min for v in ordered if v.min is not None]
    highs = [v.max for v in ordered if v.max is not None]
    dependencies = [v.dependencies for v in ordered if v.dependencies is not None]
    descriptions = {v.description for v in ordered}
    units = tuple(v.unit for v in ordered)
    uniform = len(set(units)) == 1
    return Variable(
        name=name,
        type=first.type,
        causality=first.causality,
        variability=first.variability,
        shape=shape,
        unit=first.unit if uniform else None,
        element_units=() if uniform else units,
        start=start,
        # The union of the elements' ranges; the FMU itself checks the narrower ones.
        min=min(lows) if len(lows) == len(ordered) else None,
        max=max(highs) if len(highs) == len(ordered) else None,
        description=first.description if len(descriptions) == 1 else "",
        initial=first.initial,
        negated=first.negated,
        value_references=tuple(r for v in ordered for r in v.value_references[:1]),
        dependencies=(
            tuple(dict.fromkeys(d for each in dependencies for d in each))
            if len(dependencies) == len(ordered)
            else None
        ),
    )
