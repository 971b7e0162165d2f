"""Reader of the variables of an FMI 2.0 model description; scalars are folded into arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from xml.etree.ElementTree import Element

from uuvsim_cosim.fmus.description import Variable, VariableType
from uuvsim_cosim.fmus.description_xml import SimpleType, Source
from uuvsim_cosim.fmus.importer.array_folding import fold

__all__ = ["read_variables_fmi2"]

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
