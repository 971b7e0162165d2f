"""Plant, the backend of environments: n copies of a system that step together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ComponentFailed
from uuvsim_cosim.fmus.description import Variable

__all__ = ["Plant", "Seeds"]

Seeds = Sequence[int] | NDArray[np.uint64]


class Plant(Protocol):
    """n copies of a system: in a fused kernel, as masters, or as masters in processes.

    A copy that fails does not stop the others. It is not stepped until its next reset, and
    `failure` returns the reason.
    """

    n: int
    tick: Fraction  # s, of a communication step
    variables: Mapping[str, Variable]  # by path and name, "hull.eta"

    def gather(self) -> NDArray[np.float64]:
        """Copy the variables that the plant was made to read, one below the other: (size, n)."""

    def scatter(self, values: NDArray[np.float64]) -> None:
        """Set the inputs that the plant was made to act on, one below the other: (width, n)."""

    def step(self, ticks: int) -> None:
        """Make communication steps in all copies."""

    def reset(
        self,
        mask: NDArray[np.bool_],
        seeds: Seeds,
        start: Mapping[str, NDArray[np.generic]],
    ) -> None:
        """Go back to time 0 where the mask is true, with other system seeds and start values.

        `seeds` and the arrays of `start` have n rows; only those of the mask count. A variable that
        neither the plan nor `start` names gets its declared start value again.
        """

    @property
    def failed(self) -> NDArray[np.bool_]:
        """The copies that have failed since their reset, of shape (n,)."""

    def failure(self, row: int) -> ComponentFailed | None:
        """Return the failure of a copy, or None."""

    def close(self) -> None:
        """Free everything; a second call does nothing."""
