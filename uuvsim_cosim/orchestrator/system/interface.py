"""The interface of a system as a component: its exposed connectors, described as variables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.importer.variables_fmi2 import fold
from uuvsim_cosim.orchestrator.system.elements import Structure
from uuvsim_cosim.orchestrator.values.endpoints import resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import flat

__all__ = ["interface_of"]


def interface_of(system: Structure, descriptions: Mapping[str, Description]) -> Description:
    """Describe a system as a component; `descriptions` are those of its elements."""
    variables: dict[str, Variable] = {}
    for item in system.exposed:
        point = resolve_endpoint(item.path, descriptions)
        start = system.components[point.element].start.get(point.variable.name)
        v = replace(point.variable, name=item.name, dependencies=None)
        v = replace(v, start=start) if start is not None else v
        if not point.whole:
            i = point.elements[0]
            start = None if v.start is None else flat(v.start)[i]
            unit = v.unit_of_element(i)
            v = replace(v, shape=(), start=start, unit=unit, element_units=())
        variables.setdefault(item.name, v)
    units = {n: u for d in descriptions.values() for n, u in d.units.items()}
    folded = fold(list(variables.values()))
    return Description(system.name, "native", folded, description=system.description, units=units)
