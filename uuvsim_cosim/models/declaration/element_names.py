"""Names of elements of array variables: ``x[2]``, ``M[1,2]`` (row by row), ``der(x[1])``.

FMI 2.0 has scalars only and writes an array as scalars with such names (section 2.2.9,
variableNamingConvention "structured"). Tables, recordings and messages use the same names.
Indices count from 1.
"""

from __future__ import annotations

import re

import numpy as np

__all__ = ["element_name", "element_names", "index_text", "split_element_name"]

_ELEMENT = re.compile(r"(?P<name>.+)\[(?P<indices>\d+(?:\s*,\s*\d+)*)\](?P<end>\)?)", re.DOTALL)


def index_text(shape: tuple[int, ...], element: int) -> str:
    """Return the index of an element (flat, from 0) as text: ``[3]``, ``[1,2]``; a scalar's: ""."""
    indices = (element,) if len(shape) == 1 else np.unravel_index(element, shape) if shape else ()
    return f"[{','.join(str(i + 1) for i in indices)}]" if shape else ""


def element_name(name: str, shape: tuple[int, ...], element: int) -> str:
    """Return the name of an element (flat, from 0) of a variable; a scalar's is its own."""
    stem, end = (name[:-1], ")") if name.startswith("der(") else (name, "")
    return f"{stem}{index_text(shape, element)}{end}"


def element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of all elements of a variable; a scalar's is its own."""
    return [element_name(name, shape, i) for i in range(int(np.prod(shape)))]


def split_element_name(name: str) -> tuple[str, tuple[int, ...]]:
    """Return the variable's name and the indices, from 1; no indices where the name has none."""
    match = _ELEMENT.fullmatch(name)
    if match is None:
        return name, ()
    return match["name"] + match["end"], tuple(int(i) for i in match["indices"].split(","))
