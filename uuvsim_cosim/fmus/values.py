"""A value given for a variable becomes an array of its type and shape, or is refused."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from uuvsim_cosim.errors import FmuError, ParameterInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES

__all__ = ["checked_start", "flat_array", "parse_value"]


def flat_array(variable: Variable, value: Any, place: str) -> np.ndarray:
    """Give the value's elements, row by row, as an array of the variable's type.

    Raises FmuError for another shape, for what is no number, for an integer out of range.
    """
    if variable.type in ("String", "Binary"):
        return _objects(variable, value, place)
    try:
        given = np.asarray(value)
        numeric = given.dtype.kind in "fiub"
    except ValueError:
        numeric = False
    if not numeric:
        raise FmuError(f"{place}: {value!r}; expected {_expected(variable)}")
    if given.shape != variable.shape:
        raise FmuError(f"{place}: shape {given.shape}; expected {variable.shape}")
    dtype = DTYPES[variable.type]
    if variable.type in ("Float32", "Float64"):
        return given.astype(dtype).ravel()
    if variable.type in ("Boolean", "Clock"):
        fits = bool(np.isin(given, (0, 1)).all())
    else:
        limits = np.iinfo(np.dtype(dtype).name)
        whole = given.dtype.kind != "f" or bool(np.all(np.mod(given, 1) == 0))
        fits = whole and all(limits.min <= int(x) <= limits.max for x in given.ravel())
    if not fits:
        raise FmuError(f"{place}: {value!r}; expected {_expected(variable)}")
    return given.astype(dtype).ravel()


def _objects(variable: Variable, value: Any, place: str) -> np.ndarray:
    kind: type = str if variable.type == "String" else bytes
    given = np.empty((), dtype=object)
    if isinstance(value, (str, bytes)):
        given[()] = value
    else:
        given = np.asarray(value, dtype=object)
    if given.shape != variable.shape:
        raise FmuError(f"{place}: shape {given.shape}; expected {variable.shape}")
    if not all(isinstance(x, kind) for x in given.ravel()):
        raise FmuError(f"{place}: {value!r}; expected {_expected(variable)}")
    return given.ravel()


def _expected(variable: Variable) -> str:
    one = {"String": "text", "Binary": "bytes", "Boolean": "true or false"}.get(
        variable.type, f"a number that fits {variable.type}"
    )
    return f"{one}, in an array of shape {variable.shape}" if variable.shape else one


def parse_value(
    variable: Variable, text: str, place: str, items: Mapping[int, str] | None = None
) -> Any:
    """Read a value as a user types it; array elements are separated by commas or spaces.

    `items` are the names of an enumeration. Raises ParameterInvalid.
    """
    if variable.type == "String" and not variable.shape:
        return text
    words = text.replace(",", " ").split() if variable.shape else [text.strip()]
    try:
        values = [_parse(variable, word, items or {}) for word in words]
        flat = np.asarray(values, dtype=DTYPES[variable.type])
        return flat.reshape(variable.shape) if variable.shape else values[0]
    except (ValueError, OverflowError):
        names = f" or one of {', '.join(items.values())}" if items else ""
        raise ParameterInvalid(
            f"{place}: {text!r}; expected {_expected(variable)}{names}"
        ) from None


def _parse(variable: Variable, word: str, items: Mapping[int, str]) -> Any:
    if variable.type in ("Boolean", "Clock"):
        truth = {"true": True, "1": True, "false": False, "0": False}
        if word.lower() not in truth:
            raise ValueError(word)
        return truth[word.lower()]
    if variable.type == "Binary":
        return bytes.fromhex(word)
    if variable.type == "String":
        return word
    for value, name in items.items():
        if word == name:
            return value
    if variable.type in ("Float32", "Float64"):
        return float(word)
    return int(word)


def checked_start(variable: Variable, value: Any, place: str) -> Any:
    """Give a start value of the variable's type and shape; raises ParameterInvalid.

    Beyond `flat_array`, refuses numbers that are not finite or outside [min, max].
    """
    try:
        flat = flat_array(variable, value, place)
    except FmuError as error:
        raise ParameterInvalid(str(error)) from None
    if flat.dtype != object:
        low = -np.inf if variable.min is None else variable.min
        high = np.inf if variable.max is None else variable.max
        if not np.all(np.isfinite(flat)):
            raise ParameterInvalid(f"{place}: {value!r}; expected a finite number")
        if np.any(flat < low) or np.any(flat > high):
            unit = f" {variable.unit_text}" if variable.unit_text else ""
            raise ParameterInvalid(
                f"{place}: {value!r} is out of range; expected [{low:g}, {high:g}]{unit}"
            )
    return flat.reshape(variable.shape) if variable.shape else flat[0]
