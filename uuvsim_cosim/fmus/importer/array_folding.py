"""Folding of FMI 2.0's scalars ``x[1] … x[n]`` into one variable of shape (n,)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.models.declaration.element_names import split_element_name

__all__ = ["fold"]


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
