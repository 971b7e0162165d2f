"""Checks of start values by name, one row for each environment."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["rows_of"]

Array = NDArray[np.float64]


def rows_of(variables: Mapping[str, Variable], name: str, value: object, n: int) -> Array:
    """Return a start value with one row for each of n environments; raises InputInvalid."""
    variable = variables.get(name)
    if variable is None:
        expected = expected_names(name, variables, "COMPONENT.VARIABLE")
        raise InputInvalid(f"start value {name!r}", "no such variable", expected)
    if variable.causality not in ("input", "parameter"):
        raise InputInvalid(
            f"start value {name!r}",
            f"is of causality {variable.causality}",
            "a parameter or an input",
        )
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputInvalid(f"start value {name!r}", f"{value!r}", "numbers") from None
    shape = (n, *variable.shape)
    good = np.isfinite(array).all()
    if array.shape not in (shape, variable.shape) or not good:
        read = f"of shape {array.shape}" if good else "that are not finite"
        raise InputInvalid(
            f"start value {name!r}",
            f"numbers {read}",
            f"finite ones of shape {variable.shape} or {shape}",
        )
    low = -np.inf if variable.min is None else variable.min
    high = np.inf if variable.max is None else variable.max
    outside = np.argwhere((array < low) | (array > high))
    if len(outside):
        first = tuple(outside[0])
        where = f" in environment {first[0]}" if array.shape == shape and n > 1 else ""
        raise InputInvalid(
            f"start value {name!r}", f"{array[first]}{where}", f"finite numbers in [{low}, {high}]"
        )
    return array if array.shape == shape else np.broadcast_to(array, shape)
