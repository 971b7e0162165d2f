"""Conversion of values to arrays of a variable's type and shape, with a check."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from uuvsim_cosim.errors import FmuError, ParameterInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES

__all__ = [
    "checked_start", "flat_array", "is_within", "parse_value", "range_text", "split_array",
]  # fmt: skip


def flat_array(variable: Variable, value: object, place: str) -> np.ndarray:
    """Return the value's elements, row by row, as an array of the variable's type.

    Raises FmuError for another shape, for a value of another type, for an integer out of range.
    """
    if variable.type in ("String", "Binary"):
        return _objects(variable, value, place)
    given = _numbers(value)
    if given is None:
        raise FmuError(place, f"{value!r}", _expected(variable))
    if given.shape != variable.shape:
        raise FmuError(
            f"{place}: shape {given.shape}; expected {variable.shape}, {_expected(variable)}"
            if variable.shape
            else f"{place}: shape {given.shape}; expected {variable.shape}"
        )
    dtype = DTYPES[variable.type]
    if variable.type in ("Float32", "Float64"):
        return given.astype(dtype).ravel()
    if variable.type in ("Boolean", "Clock"):
        fits = bool(np.isin(given, (0, 1)).all())
    else:
        limits = np.iinfo(np.dtype(dtype).name)
        fits = all(x % 1 == 0 and limits.min <= x <= limits.max for x in given.ravel().tolist())
    if not fits:
        raise FmuError(place, f"{value!r}", _expected(variable))
    return given.astype(dtype).ravel()


def _numbers(value: object) -> np.ndarray | None:
    """Return numbers as an array that represents them exactly; None for other values.

    NumPy would convert integers to floats if some do not fit Int64; here they stay Python's.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind in "fO" and not isinstance(value, (float, np.ndarray, np.generic)):
            kept = np.asarray(value, dtype=object)
            numeric = (bool, int, float, np.bool_, np.integer, np.floating)
            if not all(isinstance(x, numeric) for x in kept.ravel()):
                return None
            if any(isinstance(x, (int, np.integer)) for x in kept.ravel()):
                return kept
            return given if given.dtype.kind == "f" else None
    except (ValueError, OverflowError):
        return None
    return given if given.dtype.kind in "fiub" else None


def _objects(variable: Variable, value: object, place: str) -> np.ndarray:
    """Return texts or bytes as an array of objects; NumPy's own types would cut zeros."""
    cls: type = str if variable.type == "String" else bytes
    given = np.empty((), dtype=object)
    if isinstance(value, (str, bytes)):
        given[()] = value
    else:
        given = np.asarray(value, dtype=object)
    if given.shape != variable.shape:
        raise FmuError(place, f"shape {given.shape}", variable.shape)
    if not all(isinstance(x, cls) for x in given.ravel()):
        raise FmuError(place, f"{value!r}", _expected(variable))
    return given.ravel()


def _expected(variable: Variable) -> str:
    one = {"String": "text", "Binary": "bytes", "Boolean": "true or false"}.get(
        variable.type, f"a number that fits {variable.type}"
    )
    return f"{one}, in an array of shape {variable.shape}" if variable.shape else one


def parse_value(
    variable: Variable, text: str, place: str, items: Mapping[int, str] | None = None
) -> Any:
    """Read a value as a user types it: ``5``, ``5,6,7``, ``[5, 6, 7]`` or ``[[1, 2], [3, 4]]``.

    Elements of an array are separated by commas or blanks. Brackets around them, and around each
    row of a matrix, are optional. `items` are the names of an enumeration. Raises
    ParameterInvalid.
    """
    if variable.type == "String" and not variable.shape:
        return text
    try:
        if not variable.shape:
            value = _parse(variable, text.strip(), items or {})
            np.asarray(value, dtype=DTYPES[variable.type])
            return value
        words, shape = split_array(text)
        if shape not in (None, variable.shape):
            raise ValueError(text)
        values = [_parse(variable, word, items or {}) for word in words]
        return np.array(values, dtype=DTYPES[variable.type]).reshape(variable.shape)
    except (ValueError, OverflowError):
        names = f" or one of {', '.join(items.values())}" if items else ""
        raise ParameterInvalid(
            place, f"{text!r}", f"{_expected(variable)}{names}{_form(variable)}"
        ) from None


def split_array(text: str) -> tuple[list[str], tuple[int, ...] | None]:
    """Split ``1,2``, ``1 2``, ``[1, 2]`` or ``[[1, 2], [3, 4]]`` into its elements, row by row.

    The shape results from nested brackets; it is None with one pair of brackets or none. Raises
    ValueError for brackets that do not match, or rows of different length.
    """
    stripped = text.strip()
    if not stripped.startswith("["):
        if "[" in stripped or "]" in stripped:
            raise ValueError(text)
        return stripped.replace(",", " ").split(), None
    words, shape, rest = _bracket(stripped)
    if rest.strip():
        raise ValueError(text)
    return words, shape if len(shape) > 1 else None


def _bracket(text: str) -> tuple[list[str], tuple[int, ...], str]:
    """Read the content of a pair of brackets at the begin of a text; return also the rest."""
    inner = text[1:].lstrip()
    if not inner.startswith("["):
        content, close, rest = inner.partition("]")
        if not close or "[" in content:
            raise ValueError(text)
        words = content.replace(",", " ").split()
        return words, (len(words),), rest
    words, shapes = [], []
    while inner.startswith("["):
        row, shape, inner = _bracket(inner)
        words += row
        shapes.append(shape)
        inner = inner.lstrip().removeprefix(",").lstrip()
    if not inner.startswith("]") or len(set(shapes)) != 1:
        raise ValueError(text)
    return words, (len(shapes), *shapes[0]), inner[1:]


def _form(variable: Variable) -> str:
    """Return an example of how to write an array, for the end of an error message."""
    if not variable.shape or variable.type in ("String", "Binary"):
        return ""
    flat = ["true" if variable.type == "Boolean" else str(i) for i in range(variable.size)]
    if len(flat) > 9 or not flat:
        return ", separated by commas, row by row"
    nested = np.array(flat, object).reshape(variable.shape).tolist()
    shown = str(nested).replace("'", "")
    return f", such as {','.join(flat)!r} or {shown!r}"


def _parse(variable: Variable, word: str, items: Mapping[int, str]) -> object:
    """Read one element; raises ValueError."""
    if variable.type in ("Boolean", "Clock"):
        booleans = {"true": True, "1": True, "false": False, "0": False}
        if word.lower() not in booleans:
            raise ValueError(word)
        return booleans[word.lower()]
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


def checked_start(variable: Variable, value: object, place: str) -> Any:
    """Return a start value of the variable's type and shape; raises ParameterInvalid.

    In addition to the checks of `flat_array`, numbers must be finite and in [min, max].
    """
    try:
        flat = flat_array(variable, value, place)
    except FmuError as error:
        raise ParameterInvalid(str(error)) from None
    if flat.dtype != object:
        if not np.all(np.isfinite(flat)):
            raise ParameterInvalid(place, f"{value!r}", "a finite number")
        if not all(is_within(variable, x) for x in flat.tolist()):
            unit = f" {variable.unit_text}" if variable.unit_text else ""
            raise ParameterInvalid(
                place, f"{value!r} is out of range", f"{range_text(variable)}{unit}"
            )
    return flat.reshape(variable.shape) if variable.shape else flat[0]


def is_within(variable: Variable, value: float) -> bool:
    """Return whether an element is in [min, max]; integers are compared exactly."""
    low = variable.min is None or value >= variable.min
    return low and (variable.max is None or value <= variable.max)


def range_text(variable: Variable) -> str:
    """Return ``[min, max]`` for a reader, with all digits of integers."""
    ends = (-np.inf if variable.min is None else variable.min,
            np.inf if variable.max is None else variable.max)  # fmt: skip
    return f"[{', '.join(str(e) if isinstance(e, int) else f'{e:g}' for e in ends)}]"
