"""Conversion of users' values (number, list, text with a unit) to a variable's type and unit."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from uuvsim_cosim.errors import Problem
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.values import is_within, range_text, split_array
from uuvsim_cosim.models.declaration.units import Unit, parse_unit, value_conversion

__all__ = ["Misfit", "Quantity", "as_array", "conversion", "fit", "flat", "is_float", "unit_named"]

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBERS = re.compile(rf"\s*\[?\s*({_NUMBER}(?:[\s,;]+{_NUMBER})*)\s*\]?\s*(.*?)\s*$", re.DOTALL)
_NESTED = re.compile(r"\s*(\[\s*\[.*\])\s*([^\]]*?)\s*$", re.DOTALL)  # a matrix and its unit
_BOOLEANS = {"true": True, "false": False, "1": True, "0": False}
_RANGES = {
    f"{sign}Int{bits}": ((0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1))
    for sign in ("", "U")
    for bits in (8, 16, 32, 64)
}


@dataclass(frozen=True)
class Quantity:
    """A value with the name of its unit, and the file's definition of that unit, if any.

    The variable that it is set on gets factor · value + offset, in the variable's unit.
    """

    value: object
    unit: str | None
    definitions: Mapping[str, Unit] = field(default_factory=dict)
    factor: float = 1.0
    offset: float = 0.0


class Misfit(Exception):
    """A value that does not fit its variable: the value that was read, and the expected one."""

    def __init__(self, read: str, expected: str) -> None:
        super().__init__(f"{read}; expected {expected}")
        self.read = read
        self.expected = expected

    def at(self, place: str) -> Problem:
        """Return the problem at a place."""
        return Problem(place, self.read, self.expected)


def is_float(variable: Variable) -> bool:
    """Return whether the variable is of a floating-point type; only these have units."""
    return variable.type in ("Float64", "Float32")


def unit_named(name: str, units: Mapping[str, Unit]) -> Unit | None:
    """Find a unit by name: as the component defines it, else in our table; None if unknown."""
    if name in units:
        return units[name]
    try:
        return parse_unit(name)
    except ValueError:
        return None


def conversion(
    source: str, target: str, units: Mapping[str, Unit], *, of_value: bool = False
) -> tuple[float, float] | None:
    """Return (factor, offset) from one unit to the other; None if they are not commensurable.

    `of_value`: for a value that a user wrote, in which revolutions are angles
    (`value_conversion`).
    """
    if source == target:
        return 1.0, 0.0
    a, b = unit_named(source, units), unit_named(target, units)
    if a is None or b is None:
        return None
    if of_value:
        return value_conversion(a, b)
    return a.conversion_to(b) if a.commensurable(b) else None


def fit(
    variable: Variable,
    given: object,
    unit: str | None = None,
    units: Mapping[str, Unit] | None = None,
) -> Any:
    """Return the value in the variable's type, shape and unit: a scalar, or nested tuples.

    `unit` is the unit of `given`; a text may carry its own (``"0.4 m/s"``). Raises Misfit.
    """
    scale = (1.0, 0.0)
    if isinstance(given, Quantity):
        units = {**(units or {}), **given.definitions}
        scale = (given.factor, given.offset)
        unit = given.unit
        given = given.value
    if variable.type == "Enumeration":
        given = _items(variable, given)
    if isinstance(given, str) and variable.type != "String":
        given, own = _parsed(variable, given)
        unit = own or unit
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if isinstance(given, list | tuple | np.generic) is False and not np.isscalar(given):
        raise Misfit(f"a {type(given).__name__}", _type_text(variable))
    elements: list[Any] = [_element(variable, e) for e in flat(given)]
    try:
        shape = () if isinstance(given, bytes) else np.asarray(given).shape
    except ValueError:
        raise Misfit("lists of different lengths", _type_text(variable)) from None
    if shape != variable.shape and not (len(variable.shape) > 1 and shape == (variable.size,)):
        read = "a scalar" if shape == () else f"{len(elements)} values"
        if len(shape) > 1:
            read = f"values of shape {' x '.join(map(str, shape))}"
        raise Misfit(read, _type_text(variable) if variable.shape else "a scalar")
    if unit is not None and is_float(variable):
        for i, wanted in enumerate(variable.units):
            known = units or {}
            pair = (1.0, 0.0) if wanted is None else conversion(unit, wanted, known, of_value=True)
            if pair is None:
                raise Misfit(f"a value in {unit!r}", f"one in {wanted!r} or a unit of its kind")
            if pair != (1.0, 0.0):
                elements[i] = pair[0] * elements[i] + pair[1]
    if scale != (1.0, 0.0):
        factor, offset = scale
        for i, e in enumerate(elements):
            value = factor * e + offset
            if isinstance(e, int) and abs(e) > 2**53:  # a float would round it
                exact = Fraction(factor) * e + Fraction(offset)
                value = int(exact) if exact.denominator == 1 else float(exact)
            elements[i] = _element(variable, value)
    for e in elements:
        if not isinstance(e, str | bytes | bool) and not is_within(variable, e):
            of_unit = f" {variable.unit}" if variable.unit not in (None, "1") else ""
            shown = str(e) if isinstance(e, int) else f"{e:g}"
            raise Misfit(
                f"{shown}{of_unit} is out of range", f"a value in {range_text(variable)}{of_unit}"
            )
    return _shaped(elements, variable.shape)


def _items(variable: Variable, given: object) -> object:
    """Replace the names of an enumeration's items by their numbers, in nested sequences too."""
    if isinstance(given, list | tuple):
        return [_items(variable, part) for part in given]
    if not isinstance(given, str):
        return given
    numbers = dict(variable.items)
    if given in numbers:
        return numbers[given]
    if variable.items and _NUMBERS.match(given) is None:
        names = ", ".join(repr(name) for name in numbers)
        raise Misfit(repr(given), f"an item of its enumeration, {names}, or a number")
    return given


def as_array(variable: Variable, value: object) -> Any:
    """Return a fitted value in the form of `Component.set`: a scalar, or an array of its shape."""
    if variable.shape == ():
        return value
    return np.array(flat(value), dtype=DTYPES[variable.type]).reshape(variable.shape)


def flat(value: object) -> list[Any]:
    """List the elements of nested sequences, row by row."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [element for part in value for element in flat(part)]
    return [value]


def _parsed(variable: Variable, text: str) -> tuple[object, str | None]:
    """Return the value or values of a text, and the unit behind them; raises Misfit."""
    if variable.type == "Binary":
        return text.encode(), None
    expected = f"{_type_text(variable)} such as {_example(variable)}"
    if (nested := _NESTED.match(text)) is not None:  # a matrix: write it without inner brackets
        matrix, unit = nested.groups()
        try:
            elements, shape = split_array(matrix)
        except ValueError:
            raise Misfit(f"{matrix!r}, whose rows differ in length", expected) from None
        if shape != variable.shape:
            raise Misfit(f"values of shape {' x '.join(map(str, shape or ()))}", expected)
        text = f"[{', '.join(elements)}] {unit}"
    words = text.replace("[", " ").replace("]", " ").replace(",", " ").split()
    if variable.type == "Boolean" and words and all(w.lower() in _BOOLEANS for w in words):
        values = [_BOOLEANS[w.lower()] for w in words]
        return (values if variable.shape else values[0]) if len(values) == 1 else values, None
    parts = [part.strip(" []") for part in re.split(r"[,;]", text)]
    if len(parts) == 1:  # separated by blanks, where "1 2 m" is two numbers and a unit
        words = text.replace("[", " ").replace("]", " ").split()
        parts = words if len(words) == variable.size > 1 else []
    for place, part in enumerate(parts, 1):
        if not part:
            raise Misfit(f"{text!r}, where element {place} is empty", expected)
        unit = r"(?![\w.])" if place < len(parts) else ""  # the last may be followed by a unit
        if variable.type != "Boolean" and not re.match(_NUMBER + unit, part):
            raise Misfit(f"{text!r}, where element {place}, {part!r}, is no number", expected)
    match = _NUMBERS.match(text)
    if match is None:
        raise Misfit(f"{text!r}", expected)
    numbers = [
        int(n) if re.fullmatch(r"[-+]?\d+", n) else float(n) for n in re.split(r"[\s,;]+", match[1])
    ]
    bare = len(numbers) == 1 and (variable.shape == () or "[" not in text)
    return (numbers[0] if bare else numbers), match[2] or None


def _type_text(variable: Variable) -> str:
    if variable.shape:
        extents = " x ".join(str(n) for n in variable.shape)
        return f"{extents} values of type {variable.type}"
    return f"a value of type {variable.type}"


def _example(variable: Variable) -> str:
    unit = f" {variable.unit}" if variable.unit not in (None, "1") else ""
    if variable.type == "Boolean":
        return "true"
    number = "0.4" if is_float(variable) else "4"
    if len(variable.shape) == 2 and variable.size <= 9:
        row = f"[{', '.join([number] * variable.shape[1])}]"
        return f"'[{', '.join([row] * variable.shape[0])}]{unit}'"
    if variable.shape:
        return (
            f"'[{', '.join([number] * min(variable.size, 3))}{', …' * (variable.size > 3)}]{unit}'"
        )
    return f"'{number}{unit}'"


def _element(variable: Variable, value: object) -> float | str | bytes:
    """Return one element as the variable's type; raises Misfit."""
    if isinstance(value, np.generic):
        value = value.item()
    type_ = variable.type
    if type_ == "String":
        if isinstance(value, str):
            return value
    elif type_ == "Binary":
        if isinstance(value, bytes):
            return value
    elif type_ == "Boolean":
        if isinstance(value, bool) or value in (0, 1):
            return bool(value)
    elif isinstance(value, bool):
        pass  # a Boolean is an int for Python, but not for a numeric variable
    elif is_float(variable):
        # An integer can be above the largest Float64.
        if isinstance(value, int | float) and abs(value) <= sys.float_info.max:
            return float(value)
    elif isinstance(value, int) or (isinstance(value, float) and value.is_integer()):
        low, high = _RANGES.get(type_, (-(2**63), 2**63 - 1))
        if low <= value <= high:
            return int(value)
    raise Misfit(f"{value!r}", f"{_type_text(variable)} such as {_example(variable)}")


def _shaped(elements: list[Any], shape: tuple[int, ...]) -> Any:
    if shape == ():
        return elements[0]
    if len(shape) == 1:
        return tuple(elements)
    step = len(elements) // shape[0] if shape[0] else 0
    return tuple(_shaped(elements[i * step : (i + 1) * step], shape[1:]) for i in range(shape[0]))
