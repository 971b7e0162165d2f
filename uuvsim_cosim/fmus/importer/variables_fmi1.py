"""Reader of the variables of an FMI 1.0 model description, in the terms of FMI 3.0.

FMI 1.0 has other causalities: a variable that is ``internal`` or ``none`` is a local variable here.
One of variability ``parameter``, unless it is an output, is a parameter if it has a start value,
and a calculated parameter otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from xml.etree.ElementTree import Element

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import SimpleType, Source
from uuvsim_cosim.fmus.importer.variables_fmi2 import TYPES, fold

__all__ = ["read_variables_fmi1"]

_CAUSALITIES = ("input", "output", "internal", "none")
_VARIABILITIES = ("constant", "parameter", "discrete", "continuous")
_ALIASES = ("noAlias", "alias", "negatedAlias")


def read_variables_fmi1(
    source: Source, root: Element
) -> tuple[dict[str, Variable], dict[str, Mapping[int, str]]]:
    """Return the variables by name, and the items of those that are enumerations."""
    types: dict[str, SimpleType] = {}
    for e in root.iterfind("TypeDefinitions/Type"):
        name, inner = source.required(e, "name", "a type"), next(iter(e), None)
        attributes = {} if inner is None else dict(inner.attrib)
        listed = () if inner is None else inner.iterfind("Item")
        # Items have no numbers in FMI 1.0: they count from 1.
        types[name] = SimpleType(
            attributes, {i: item.get("name", "") for i, item in enumerate(listed, 1)}
        )
    scalars: dict[str, Variable] = {}
    again: list[str] = []
    settable: list[str] = []
    enumerations: dict[str, Mapping[int, str]] = {}
    for element in root.iterfind("ModelVariables/ScalarVariable"):
        name = source.required(element, "name", "a variable")
        scalar, declared = _scalar(source, element, types, f"variable {name!r}")
        if name in scalars:
            if {scalar.causality, scalars[name].causality} != {"local"}:
                raise source.fault(f"variable {name!r}", "declared twice", "unique names")
            again.append(name)
            continue
        scalars[name] = scalar
        if (element.get("causality"), element.get("variability")) == ("input", "parameter"):
            settable.append(name)
        if scalars[name].type == "Enumeration" and declared is not None:
            enumerations[name] = declared.items
    for element in root.iterfind("ModelVariables/ScalarVariable"):
        listed_inputs = element.find("DirectDependency")
        if listed_inputs is not None:
            name = element.get("name", "")
            names = [(e.text or "").strip() for e in listed_inputs.iterfind("Name")]
            for other in names:
                if other not in scalars:
                    where = f"DirectDependency of {name!r}"
                    raise source.fault(where, f"no variable {other!r}", "names of inputs")
            inputs = tuple(n for n in names if scalars[n].causality == "input")
            scalars[name] = replace(scalars[name], dependencies=inputs)
    if again:
        source.remarks.append(
            f"its description declares twice: {_listed(again)}; the first declaration is used"
        )
    if settable:
        source.remarks.append(
            f"its inputs of variability parameter are parameters here: {_listed(settable)}"
        )
    return fold(list(scalars.values())), enumerations


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return ", ".join(names[:5]) + more


def _scalar(
    source: Source, element: Element, types: Mapping[str, SimpleType], where: str
) -> tuple[Variable, SimpleType | None]:
    inner = next((e for e in element if e.tag in TYPES), None)
    if inner is None:
        raise source.fault(where, "no type", f"one of {', '.join(TYPES)}")
    declared, attributes = source.declared(inner, types, where)
    type_, start = TYPES[inner.tag], attributes.get("start")

    def one_of(attribute: str, default: str, allowed: tuple[str, ...]) -> str:
        given = element.get(attribute, default)
        if given not in allowed:
            raise source.fault(where, f"{attribute} {given!r}", f"one of {', '.join(allowed)}")
        return given

    variability = "continuous" if type_ == "Float64" else "discrete"
    variability = one_of("variability", variability, _VARIABILITIES)
    causality = one_of("causality", "internal", _CAUSALITIES)
    alias = one_of("alias", "noAlias", _ALIASES)
    if alias == "negatedAlias" and type_ in ("String", "Enumeration"):
        raise source.fault(where, f"a negated alias of type {inner.tag}", "a number or a Boolean")
    if causality in ("internal", "none"):
        causality = "local"
    if variability == "parameter":
        variability = "fixed"
        if causality != "output":
            causality = "calculatedParameter" if start is None else "parameter"
    translated = {**element.attrib, "causality": causality, "variability": variability}
    if start is not None:
        translated["initial"] = "approx" if attributes.get("fixed") in ("false", "0") else "exact"
    variable = source.variable(
        Element(element.tag, translated),
        attributes,
        type_,
        where,
        start=None if start is None else source.value(type_, start, where),
        description=element.get("description", ""),
        negated=alias == "negatedAlias",
    )
    return variable, declared
