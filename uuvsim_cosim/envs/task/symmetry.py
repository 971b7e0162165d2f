"""Symmetry of a task, a mirror image or a half turn, as signs of an agent's numbers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["Symmetry"]

Array = NDArray[np.float64]


@dataclass(frozen=True, init=False, eq=False)
class Symmetry:
    """Factors, each 1 or -1, of an observation (width,) and of an action (width,).

    Raises InputInvalid for other numbers.
    """

    name: str
    observation: Array = field(repr=False)
    action: Array = field(repr=False)

    def __init__(self, name: str, observation: ArrayLike, action: ArrayLike) -> None:
        for what, given in (("observation", observation), ("action", action)):
            try:
                signs = np.array(given, np.float64)
                wrong = signs.ndim != 1 or not np.isin(signs, (1.0, -1.0)).all()
            except (TypeError, ValueError):
                wrong = True
            if wrong:
                raise InputInvalid(
                    f"symmetry {name!r}, {what}", f"{given!r}", "a row of signs, each 1 or -1"
                )
            object.__setattr__(self, what, signs)
        object.__setattr__(self, "name", name)

    def check(self, observed: int, acted: int) -> None:
        """Raise InputInvalid unless it is of observations and actions of these widths."""
        of = {"observation": (self.observation, observed), "action": (self.action, acted)}
        for what, (signs, width) in of.items():
            if len(signs) != width:
                raise InputInvalid(f"symmetry {self.name!r}, {what}", f"{len(signs)} signs", width)
