"""Endpoints such as ``allocation.u[3]`` or ``a.y[1:3]``: elements of one connector."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.models.declaration.near_names import close_names, expected_names
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = [
    "Endpoint",
    "find_element",
    "find_variable",
    "resolve_endpoint",
]

_CONNECTABLE = ("input", "output", "parameter")
_INDEXED = re.compile(r"(?P<name>.*?)\[(?P<index>[^\[\]]*)\](?P<end>\)?)$", re.DOTALL)


@dataclass(frozen=True)
class Endpoint:
    """Elements (flat, from 0) of an element's variable; `whole` if it was named without index."""

    element: str
    variable: Variable
    elements: tuple[int, ...]
    whole: bool

    def texts(self) -> list[str]:
        """Return the text of each element, such as ``allocation.u[3]``."""
        return [f"{self.element}.{self.variable.element_name(i)}" for i in self.elements]


def find_element(path: str, names: Mapping[str, object]) -> tuple[str, str]:
    """Split ``element.rest`` at the longest element name that exists; raises Misfit."""
    parts = path.split(".")
    for n in range(len(parts) - 1, 0, -1):
        name = ".".join(parts[:n])
        if name in names:
            return name, ".".join(parts[n:])
    if path in names:
        raise Misfit(f"{path!r} names a component", f"{path}.VARIABLE")
    if len(parts) == 1:
        raise Misfit(f"{path!r}", "COMPONENT.VARIABLE")
    raise Misfit(
        f"no component {parts[0]!r}", expected_names(parts[0], names, "the name of a component")
    )


def find_variable(text: str, description: Description) -> tuple[Variable, tuple[int, ...], bool]:
    """Find the variable and the elements that ``name`` or ``name[index]`` means; raises Misfit."""
    variables = description.variables
    if text in variables:
        variable = variables[text]
        return variable, tuple(range(variable.size)), True
    match = _INDEXED.match(text)
    name = match["name"] + match["end"] if match else text
    if match is None or name not in variables:
        # Suggest inputs, outputs and parameters; other variables only if their name is similar.
        names = [v.name for v in variables.values() if v.causality in _CONNECTABLE]
        names += [c for c in close_names(name, variables, 0.8) if c not in names]
        raise Misfit(
            f"no variable {name!r} in {description.name}",
            expected_names(name, names, "the name of a variable"),
        )
    variable = variables[name]
    return variable, _indices(variable, match["index"]), False


def resolve_endpoint(text: str, descriptions: Mapping[str, Description]) -> Endpoint:
    """Resolve an endpoint of a system; raises Misfit with the close names."""
    element, rest = find_element(text, descriptions)
    variable, elements, whole = find_variable(rest, descriptions[element])
    return Endpoint(element, variable, elements, whole)


def _indices(variable: Variable, text: str) -> tuple[int, ...]:
    """Return the flat indices, from 0, of a text such as ``2`` or ``1:3,4``; raises Misfit."""
    read = f"index [{text}] of {variable.name}"
    expected = f"indices from 1 to {' x '.join(map(str, variable.shape))}, as [2] or [1:3]"
    if variable.shape == ():
        raise Misfit(read, f"{variable.name}, which is a scalar")
    parts = text.split(",")
    if len(parts) != len(variable.shape):
        raise Misfit(read, expected)
    ranges: list[range] = []
    for part, extent in zip(parts, variable.shape, strict=True):
        match = re.fullmatch(r"\s*(\d+)\s*(?::\s*(\d+)\s*)?", part)
        low = int(match[1]) if match else 0
        high = int(match[2]) if match and match[2] else low
        if not 1 <= low <= high <= extent:
            if match and low == 0:
                expected += "; indices count from 1"
            raise Misfit(read, expected)
        ranges.append(range(low - 1, high))
    grid = np.meshgrid(*ranges, indexing="ij")
    index = np.ravel_multi_index([g.ravel() for g in grid], variable.shape)
    return tuple(int(i) for i in index)
