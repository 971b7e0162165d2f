"""Variables from the declarations of a user's class: inputs, outputs and parameters."""

from __future__ import annotations

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Causality, Variable
from uuvsim_cosim.models.declaration.units import unit_of

__all__ = ["parameter", "signal"]


def signal(place: str, name: str, declared: object, causality: Causality) -> Variable:
    """Read a unit, a size, (size, unit) or (size, units); None or no unit: not known."""
    size: object = None
    units: object = declared
    if isinstance(declared, (tuple, list)) and len(declared) == 2:
        size, units = declared
    elif isinstance(declared, (int, np.integer)):
        size, units = declared, None
    units = (units,) if units is None or isinstance(units, str) else units
    if size is None:
        shape: tuple[int, ...] | None = ()
    elif isinstance(size, (int, np.integer)) and not isinstance(size, bool) and size > 0:
        shape = (int(size),)
    else:
        shape = None
    if (
        shape is None
        or not isinstance(units, (tuple, list))
        or len(units) not in (1, size)
        or not all(u is None or isinstance(u, str) for u in units)
    ):
        raise InputInvalid(
            f"{place}.{name}",
            f"{declared!r}",
            (
                "a unit such as 'm/s' (None if unknown), a size, (size, unit), or "
                "(size, (unit, unit, ...)) with one unit for each element"
            ),
        )
    for each in units:
        if each is not None:
            unit_of(each, f"{place}.{name}")
    return Variable(
        name=name,
        type="Float64",
        causality=causality,
        variability="continuous",
        shape=shape,
        unit=units[0] if len(units) == 1 else None,
        element_units=() if len(units) == 1 else tuple(units),
        start=np.zeros(shape) if shape else 0.0,
        dependencies=() if causality == "output" else None,
    )


def parameter(place: str, name: str, declared: object) -> Variable:
    """Read (value, unit); the unit may be None."""
    if not (isinstance(declared, (tuple, list)) and len(declared) == 2):
        raise InputInvalid(f"{place}.{name}", f"{declared!r}", "(value, unit)")
    value, unit = declared
    if unit is not None:
        if not isinstance(unit, str):
            raise InputInvalid(f"{place}.{name}", f"unit {unit!r}", "text such as 'm/s'")
        unit_of(unit, f"{place}.{name}")
    if isinstance(value, str):
        return Variable(name, "String", "parameter", "tunable", start=value)
    if isinstance(value, bool):
        return Variable(name, "Boolean", "parameter", "tunable", start=value)
    try:
        array = np.array(value, np.int32 if name == "seed" else float)
    except (TypeError, ValueError, OverflowError):
        raise InputInvalid(f"{place}.{name}", f"{value!r}", "numbers, text or a bool") from None
    return Variable(
        name=name,
        type="Int32" if name == "seed" else "Float64",
        causality="parameter",
        variability="tunable",
        shape=array.shape,
        unit=unit,
        start=array if array.shape else array.item(),
    )
