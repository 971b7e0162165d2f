"""Description of a declaration as a component, without compiling it."""

from __future__ import annotations

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.fmus.codegen.dependencies import sparsity_rows
from uuvsim_cosim.fmus.codegen.equations import Equations, equations
from uuvsim_cosim.fmus.description import Causality, Description, Variable
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.units import parse_unit

__all__ = ["describe", "direct_dependencies"]

CAUSALITY: dict[str, Causality] = {
    "input": "input",
    "parameter": "parameter",
    "state": "local",
    "discrete": "local",
    "output": "output",
}


def describe(model: Model, eq: Equations | None = None) -> Description:
    """Return the description of a declaration; value references are offsets in its block."""
    eq = equations(model) if eq is None else eq
    depends = direct_dependencies(eq)
    variables: dict[str, Variable] = {}
    for p in eq.layout.placed:
        v = p.variable
        if v.kind == "derived":
            continue
        start: float | np.ndarray | None = None
        if v.kind in ("input", "parameter"):
            cast = {"Float64": float, "Int32": int, "Boolean": bool}[v.type]
            flat = np.array([cast(x) for x in v.start])
            start = flat.reshape(v.shape) if v.shape else flat[0].item()
        variables[v.name] = Variable(
            name=v.name,
            type=v.type,
            causality=CAUSALITY[v.kind],
            variability=v.variability,  # type: ignore[arg-type]
            shape=v.shape,
            unit=v.unit if v.type == "Float64" and not v.units else None,
            start=start,
            min=v.min,
            max=v.max,
            soft_min=v.soft_min,
            description=v.description,
            initial="exact" if start is not None else "calculated",
            value_references=(p.offset,),
            dependencies=depends.get(v.name),
            element_units=v.units,
        )
    names = {v.unit_of_element(i) for v in variables.values() for i in range(v.size)}
    units = {name: parse_unit(name) for name in sorted(n for n in names if n is not None)}
    return Description(
        name=model.name,
        kind="native",
        variables=variables,
        description=model.description,
        generation_tool=f"uuvsim-cosim {__version__}",
        units=units,
        can_get_and_set_state=True,
        can_serialize_state=True,
        provides_directional_derivatives=True,
        made_for=model.made_for,
        peers=model.peers,
    )


def direct_dependencies(eq: Equations) -> dict[str, tuple[str, ...]]:
    """Return for each output the inputs that its value depends on directly, by sparsity."""
    layout = eq.layout
    inputs = [p for p in layout.placed if p.variable.kind == "input"]
    rows = sparsity_rows(eq.outputs, 0)
    result: dict[str, tuple[str, ...]] = {}
    for p in layout.placed:
        if p.variable.kind == "output":
            first = p.offset - layout.offset["output"]
            read = set().union(*rows[first : first + p.variable.size])
            result[p.variable.name] = tuple(
                q.variable.name
                for q in inputs
                if not read.isdisjoint(range(q.offset, q.offset + q.variable.size))
            )
    return result
