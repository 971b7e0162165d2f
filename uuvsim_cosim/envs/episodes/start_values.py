"""Start values by name, one row for each environment; refused if they cannot be."""

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
        raise InputInvalid(f"start value {name!r}: no such variable; expected {expected}")
    if variable.causality not in ("input", "parameter"):
        raise InputInvalid(
            f"start value {name!r}: is of causality {variable.causality}; expected a "
            "parameter or an input"
        )
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise InputInvalid(f"start value {name!r}: {value!r}; expected numbers") from None
    shape = (n, *variable.shape)
    good = np.isfinite(array).all()
    if good and array.shape in (shape, variable.shape):
        _refuse_outside(name, array, variable, several=array.shape == shape and n > 1)
    if good and array.shape == shape:
        return array
    if array.shape not in (shape, variable.shape) or not good:
        read = f"of shape {array.shape}" if good else "that are not finite"
        raise InputInvalid(
            f"start value {name!r}: numbers {read}; expected finite ones of shape "
            f"{variable.shape} or {shape}"
        )
    return np.broadcast_to(array, shape)


def _refuse_outside(name: str, array: Array, variable: Variable, *, several: bool) -> None:
    low = -np.inf if variable.min is None else variable.min
    high = np.inf if variable.max is None else variable.max
    bad = np.argwhere((array < low) | (array > high))
    if len(bad):
        where = f" in environment {bad[0][0]}" if several else ""
        raise InputInvalid(
            f"start value {name!r}: {array[tuple(bad[0])]}{where}; expected finite numbers in "
            f"[{low}, {high}]"
        )
