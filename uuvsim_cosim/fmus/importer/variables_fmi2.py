"""Reader of the variables of an FMI 2.0 model description, with scalars folded into arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from xml.etree.ElementTree import Element

import numpy as np

from uuvsim_cosim.fmus.description import Variable, VariableType
from uuvsim_cosim.fmus.description_xml import DTYPES, SimpleType, Source
from uuvsim_cosim.models.declaration.element_names import split_element_name

__all__ = ["fold", "read_variables_fmi2"]

_TYPES: Mapping[str, VariableType] = {
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
        scalar, declared = _scalar(source, element, types)
        scalars.append(scalar)
        if scalar.type == "Enumeration" and declared is not None:
            enumerations[scalar.name] = declared.items
    for index, names in _dependencies(source, root, scalars).items():
        scalars[index] = replace(scalars[index], dependencies=names)
    names_seen: set[str] = set()
    for scalar in scalars:
        if scalar.name in names_seen:
            raise source.fault(f"variable {scalar.name!r}", "declared twice", "unique names")
        names_seen.add(scalar.name)
    return fold(scalars), enumerations


def _scalar(
    source: Source, element: Element, types: Mapping[str, SimpleType]
) -> tuple[Variable, SimpleType | None]:
    """Read a scalar variable, and the type that it declares."""
    name = source.required(element, "name", "a variable")
    where = f"variable {name!r}"
    inner = next((e for e in element if e.tag in _TYPES), None)
    if inner is None:
        raise source.fault(where, "no type", f"one of {', '.join(_TYPES)}")
    kind = _TYPES[inner.tag]
    declared_name = inner.get("declaredType")
    declared = types.get(declared_name) if declared_name is not None else None
    if declared_name is not None and declared is None:
        raise source.fault(where, f"unknown type {declared_name!r}", "one of TypeDefinitions")
    attributes = {**(declared.attributes if declared else {}), **inner.attrib}
    start = attributes.get("start")
    causality = source.causality(element, where)
    variable = Variable(
        name=name,
        type=kind,
        causality=causality,
        variability=source.variability(element, causality, kind, where),
        unit=attributes.get("unit"),
        start=None if start is None else source.value(kind, start, where),
        min=source.bound(attributes, "min", kind, where),
        max=source.bound(attributes, "max", kind, where),
        description=element.get("description", ""),
        initial=element.get("initial"),
        value_references=(source.natural(element.get("valueReference"), "valueReference", where),),
    )
    return variable, declared


def _dependencies(
    source: Source, root: Element, scalars: list[Variable]
) -> dict[int, tuple[str, ...]]:
    """Return by index the inputs on which an output is declared to depend directly."""
    declared: dict[int, tuple[str, ...]] = {}
    for unknown in root.iterfind("ModelStructure/Outputs/Unknown"):
        where = "ModelStructure/Outputs"
        index = source.natural(unknown.get("index"), "index", where)
        listed = unknown.get("dependencies")
        indices = [source.natural(t, "dependency", where) for t in (listed or "").split()]
        for i in (index, *indices):
            if not 1 <= i <= len(scalars):
                raise source.fault(where, f"index {i}", f"1 to {len(scalars)}, as of a variable")
        if listed is not None:
            known = (scalars[i - 1] for i in indices)
            declared[index - 1] = tuple(v.name for v in known if v.causality == "input")
    return declared


def fold(scalars: Sequence[Variable]) -> dict[str, Variable]:
    """Return variables by name, in the order of their first elements.

    A group is folded if its indices run from 1 to n without a gap (row by row for matrices),
    if all its elements have the same type, causality and variability, and if no scalar has its
    name; otherwise its elements stay scalars. Units of elements may differ. Dependencies are
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
        shape = _shape(elements)
        alike = len({(v.type, v.causality, v.variability) for v in elements.values()}) == 1
        if name not in scalar_names and shape is not None and alike:
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


def _shape(elements: dict[tuple[int, ...], Variable]) -> tuple[int, ...] | None:
    """Return the extents of a complete index set, else None."""
    if len({len(indices) for indices in elements}) != 1:
        return None
    extents = tuple(max(axis) for axis in zip(*elements, strict=True))
    size = 1
    for extent in extents:
        size *= extent
    complete = size == len(elements) and min(min(i) for i in elements) == 1
    return extents if complete else None


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
        value_references=tuple(r for v in ordered for r in v.value_references[:1]),
        dependencies=(
            tuple(dict.fromkeys(d for each in dependencies for d in each))
            if len(dependencies) == len(ordered)
            else None
        ),
    )
