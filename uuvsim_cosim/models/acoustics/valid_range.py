"""Range in which a formula holds: a value outside of it is refused with the range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.errors import InputInvalid, Problem

__all__ = ["Valid", "refuse_outside"]


@dataclass(frozen=True)
class Valid:
    """Least and greatest value for which a formula was published, with its unit."""

    low: float
    high: float
    unit: str


def refuse_outside(
    formula: str, ranges: Mapping[str, Valid], given: Mapping[str, ArrayLike]
) -> None:
    """Raise `InputInvalid`, with one problem for each value of `given` outside of its range."""
    problems = list(_outside(formula, ranges, given))
    if problems:
        raise InputInvalid.of(problems)


def _outside(
    formula: str, ranges: Mapping[str, Valid], given: Mapping[str, ArrayLike]
) -> Iterator[Problem]:
    for name, values in given.items():
        valid = ranges[name]
        x = np.asarray(values, float)
        wrong = x[~((x >= valid.low) & (x <= valid.high))]  # NaN is wrong too
        if wrong.size:
            expected = f"{valid.low:g} to {valid.high:g} {valid.unit}".rstrip()
            yield Problem(formula, f"{name} {wrong.flat[0]:g} {valid.unit}".rstrip(), expected)
