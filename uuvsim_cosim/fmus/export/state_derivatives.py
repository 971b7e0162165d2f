"""The derivatives of the states as variables of a model description, for Model Exchange."""

from __future__ import annotations

import re
from collections.abc import Mapping

from uuvsim_cosim.fmus.codegen.equations import Equations
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.units import Unit, parse_unit

__all__ = ["rate_units", "state_derivatives"]

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
