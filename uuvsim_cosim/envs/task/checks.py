"""Checks of arguments (of reset, of constructors) and of the results of a task's methods."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from fractions import Fraction
from math import isfinite
from numbers import Real
from operator import index
from typing import SupportsIndex

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, Problem
from uuvsim_cosim.models.declaration.near_names import did_you_mean, expected_names

__all__ = [
    "base_seed",
    "check_failure_reward",
    "infos_of",
    "mask_of",
    "refuse_infinite",
    "refuse_options",
    "rewards_of",
    "seconds",
    "start_of",
    "whole",
]

Array = NDArray[np.float64]
_KNOWN = ("start", "reset_mask")
_SEEDS = 2**64


def base_seed(seed: SupportsIndex, n: int = 1) -> int:
    """Return a seed, of n environments in a row, as a whole number; raises InputInvalid."""
    try:
        number = index(seed)
    except TypeError:
        number = -1
    if not 0 <= number <= _SEEDS - n or isinstance(seed, bool | np.bool_):
        most = "2^64 - 1" if n == 1 else f"2^64 - {n}, for {n} environments"
        raise InputInvalid(f"seed {seed!r}", f"a whole number from 0 to {most}, or None")
    return number


def start_of(
    options: Mapping[str, object] | None, *, mask: str | None = None, others: bool = False
) -> Mapping[str, object]:
    """Return the start values of reset's options; raises InputInvalid for unknown options.

    `mask` names the environment that accepts a reset_mask, if this one does not. With `others`,
    unknown options are accepted (PettingZoo's own tests pass some), except near misspellings.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InputInvalid(f"options {options!r}", "a dictionary")
    for key in options:
        if key not in _KNOWN and not (others and not did_you_mean(key, _KNOWN)):
            raise InputInvalid(f"options, {key!r}", "no such option", expected_names(key, _KNOWN))
    if mask is not None and options.get("reset_mask") is not None:
        raise InputInvalid("options, reset_mask", f"it with {mask} only")
    start = options.get("start")
    if start is None:
        return {}
    if not isinstance(start, Mapping):
        raise InputInvalid("options, start", f"{start!r}", "start values by name")
    return start


def mask_of(options: Mapping[str, object] | None, n: int) -> NDArray[np.bool_] | None:
    """Return the environments to reset, from reset's options; None is all."""
    mask = None if options is None else options.get("reset_mask")
    if mask is None:
        return None
    chosen = np.asarray(mask)
    if chosen.dtype != bool or chosen.shape != (n,) or not chosen.any():
        raise InputInvalid(
            "options, reset_mask",
            f"{chosen.dtype} of shape {chosen.shape}",
            f"{n} Booleans, at least one of them true",
        )
    return chosen.copy()


def whole(value: SupportsIndex, name: str, least: int = 1) -> int:
    """Return a whole number; raises InputInvalid."""
    try:
        number = index(value)
    except TypeError:
        number = least - 1
    if number < least or isinstance(value, bool | np.bool_):
        raise InputInvalid(f"{name} {value!r}", f"a whole number from {least}")
    return number


def seconds(value: object, name: str) -> Fraction:
    """Return a time as the fraction that is written; raises InputInvalid."""
    try:
        return Fraction(str(value))
    except (ValueError, ZeroDivisionError):
        raise InputInvalid(f"{name} {value!r}", "seconds, such as '0.1', 20 or '1/3'") from None


def refuse_options(place: str, make: Callable[..., object], given: Mapping[str, object]) -> None:
    """Refuse keyword arguments that a function does not take; raises InputInvalid."""
    try:
        parameters = inspect.signature(make).parameters.values()
    except (TypeError, ValueError):
        return
    named = [p for p in parameters if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    known = [p.name for p in named]
    if not any(p.kind is p.VAR_KEYWORD for p in parameters):
        for name in given:
            if name not in known:
                expected = expected_names(name, known, "an option of its own")
                raise InputInvalid(place, f"option {name!r}", expected)
    missing = [p.name for p in named if p.default is p.empty and p.name not in given]
    if missing:
        raise InputInvalid(place, f"no {', '.join(missing)}", "a value for each")


def check_failure_reward(given: object) -> list[Problem]:
    """Find mistakes in a task's reward of a failure."""
    if isinstance(given, Real) and isfinite(given):
        return []
    return [Problem("failure_reward", repr(given), "a finite number")]


def rewards_of(given: object, n: int, place: str) -> Array:
    """Return rewards, of shape (n,); raises InputInvalid."""
    try:
        reward = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputInvalid(place, f"{given!r}", f"numbers of shape {(n,)}") from None
    if reward.shape != (n,):
        raise InputInvalid(place, f"rewards of shape {reward.shape}", (n,))
    return reward


def refuse_infinite(numbers: NDArray[np.generic], place: str) -> None:
    """Raise InputInvalid for the first environment with a number that is not finite."""
    if np.isfinite(np.add.reduce(numbers, axis=None)):
        return
    bad = np.argwhere(~np.isfinite(numbers))
    if len(bad):
        value = numbers[tuple(bad[0])]
        which = f"number {bad[0][1]} " if numbers.ndim > 1 else ""
        raise InputInvalid(
            place, f"{which}in environment {bad[0][0]} is {value}", "a finite number"
        )


def infos_of(given: object, n: int, place: str) -> Mapping[str, NDArray[np.generic]]:
    """Return infos, of shape (n, …); raises InputInvalid."""
    if not isinstance(given, Mapping):
        raise InputInvalid(place, f"info(): {given!r}", "arrays by name")
    for name, values in given.items():
        if np.shape(values)[:1] != (n,):
            raise InputInvalid(place, f"info(), {name!r}: of shape {np.shape(values)}", f"{n} rows")
    return given
