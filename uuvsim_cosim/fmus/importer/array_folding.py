"""The scalars ``x[1] … x[n]`` of FMI 2.0 are one variable of shape (n,), if they agree."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.models.declaration.element_names import split_element_name

__all__ = ["fold"]


def fold(scalars: Sequence[Variable]) -> dict[str, Variable]:
    """Return variables by name, in the order of their first elements.

    A group is folded if its indices run from 1 to n without a gap (row by row for matrices),
    if type, causality and variability are those of all its elements, and if no scalar has its
    name; otherwise its elements stay scalars. Units may differ from element to element.
    Dependencies name what was folded.
    """
    groups: dict[str, dict[tuple[int, ...], Variable]] = {}
    for scalar in scalars:
        name, indices = split_element_name(scalar.name)
        if indices:
            groups.setdefault(name, {})[indices] = scalar
    taken = {v.name for v in scalars}
    folded_name = {v.name: v.name for v in scalars}
    arrays: dict[str, Variable] = {}
    for name, elements in groups.items():
        shape = _shape(elements)
        if name not in taken and shape is not None and _agree(list(elements.values())):
            arrays[name] = _array(name, shape, elements)
            folded_name.update({v.name: name for v in elements.values()})
    result: dict[str, Variable] = {}
    for scalar in scalars:
        name = folded_name[scalar.name]
        result.setdefault(name, arrays.get(name, scalar))
    return {name: _renamed(v, folded_name) for name, v in result.items()}


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


def _agree(elements: list[Variable]) -> bool:
    def key(v: Variable) -> tuple[Any, ...]:
        return v.type, v.causality, v.variability

    return len({key(v) for v in elements}) == 1


def _array(
    name: str, shape: tuple[int, ...], elements: dict[tuple[int, ...], Variable]
) -> Variable:
    ordered = [elements[i] for i in product(*(range(1, n + 1) for n in shape))]
    first = ordered[0]
    starts = [v.start for v in ordered]
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
        start=None if None in starts else _stack(starts, first.type, shape),
        # The range that admits what each element admits; the FMU itself knows the narrower ones.
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


def _stack(starts: list[Any], kind: str, shape: tuple[int, ...]) -> np.ndarray:
    flat = np.empty(len(starts), dtype=DTYPES[kind])
    flat[:] = starts
    return flat.reshape(shape)


def _renamed(variable: Variable, folded_name: dict[str, str]) -> Variable:
    if not variable.dependencies:
        return variable
    names = tuple(dict.fromkeys(folded_name[d] for d in variable.dependencies))
    return Variable(**{**variable.__dict__, "dependencies": names})
