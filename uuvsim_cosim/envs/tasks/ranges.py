"""Checks of the options of tasks, with messages that name the expected values."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from math import inf, isnan
from numbers import Real
from operator import index
from typing import SupportsIndex, TypeGuard

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = [
    "flag", "known_options", "numbers", "one_of", "pair", "randomised", "whole", "within",
]  # fmt: skip

_OF_SHIPPED = ("self", "signals", "reference", "disturbances")  # options for subclasses only


def within(name: str, value: object, low: float, high: float) -> float:
    """Return a number; raises InputInvalid unless low <= value <= high."""
    if _is_number(value) and low <= value <= high:
        return float(value)
    expected = f"a number of at least {low:g}" if high == inf else f"a number, {low:g} to {high:g}"
    raise InputInvalid(name, f"{value!r}", expected)


def whole(name: str, value: SupportsIndex, low: int, high: int | None = None) -> int:
    """Return a whole number; raises InputInvalid unless low <= value <= high."""
    try:
        number = index(value)
    except TypeError:
        number = low - 1
    if not low <= number or (high is not None and number > high) or isinstance(value, bool):
        to = "" if high is None else f" to {high}"
        raise InputInvalid(name, f"{value!r}", f"a whole number from {low}{to}")
    return number


def numbers(
    name: str, value: object, expected: Sequence[str], low: float = 0.0
) -> tuple[float, ...]:
    """Return one number of at least `low` for each name in `expected`; raises InputInvalid."""
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str):
        given = tuple(float(v) for v in value if _is_number(v))
        if len(value) == len(given) == len(expected) and all(low <= v < inf for v in given):
            return given
    raise InputInvalid(name, f"{value!r}", f"({', '.join(expected)}), numbers of at least {low:g}")


def pair(name: str, value: object) -> tuple[float, float]:
    """Return the least and the greatest value of a range of numbers from 0; raises InputInvalid."""
    least, greatest = numbers(name, value, ("least", "greatest"))
    if least > greatest:
        raise InputInvalid(name, f"{value!r}", "the least first")
    return least, greatest


def flag(name: str, value: object) -> bool:
    """Return a Boolean; raises InputInvalid."""
    if not isinstance(value, bool | np.bool_):
        raise InputInvalid(name, f"{value!r}", "True or False")
    return bool(value)


def one_of(name: str, value: object, known: Sequence[str]) -> None:
    """Raise InputInvalid unless a text is among those known."""
    if not isinstance(value, str) or value not in known:
        raise InputInvalid(f"{name} {value!r}", f"one of {', '.join(known)}")


def randomised(value: object) -> None:
    """Raise InputInvalid unless the value has a method `draw`, or is None."""
    if value is not None and not hasattr(value, "draw"):
        raise InputInvalid("randomisation", f"{value!r}", "a Randomisation")


def known_options(make: type, unknown: Mapping[str, object]) -> None:
    """Raise InputInvalid, with the options of the task, if there are unknown ones."""
    if not unknown:
        return
    known = [
        p.name
        for each in make.__mro__
        if "__init__" in vars(each) and each.__module__.startswith("uuvsim_cosim.envs.tasks")
        for p in inspect.signature(vars(each)["__init__"]).parameters.values()
        if p.kind is not p.VAR_KEYWORD and p.name not in _OF_SHIPPED
    ]
    name = next(iter(unknown))
    raise InputInvalid(make.__name__, f"option {name!r}", expected_names(name, known))


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, Real) and not isinstance(value, bool) and not isnan(value)
