"""Checks of the results of a task's methods: shapes, types, finite numbers."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid, Problem

__all__ = ["check_failure_reward", "infos_of", "refuse_infinite", "rewards_of"]

Array = NDArray[np.float64]


def check_failure_reward(task: Task | TeamTask) -> list[Problem]:
    """Find what is wrong with a task's reward of a failure."""
    given = task.failure_reward
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
