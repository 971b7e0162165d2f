"""What an environment stands on: n copies of a system that make communication steps together."""

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
    """n copies of a system. A kernel is one, a master another, masters in processes a third.

    A copy that fails keeps the others going: it stands still, and `failure` says why, until it is
    reset.
    """

    n: int
    tick: Fraction  # s, of a communication step
    variables: Mapping[str, Variable]  # by path and name, "hull.eta"

    def read(self, name: str) -> NDArray[np.generic]:
        """Copy a variable: of shape (n, *shape)."""

    def write(self, name: str, values: NDArray[np.generic]) -> None:
        """Set an unconnected input or a tunable parameter in all copies: (n, *shape)."""

    def gather(self) -> NDArray[np.float64]:
        """Copy what the plant was made to read, variable below variable: of shape (size, n)."""

    def scatter(self, values: NDArray[np.float64]) -> None:
        """Set what the plant was made to act on, element below element: of shape (width, n)."""

    def step(self, ticks: int) -> None:
        """Make communication steps in all copies."""

    def reset(
        self,
        mask: NDArray[np.bool_],
        seeds: Seeds,
        start: Mapping[str, NDArray[np.generic]],
    ) -> None:
        """Go back to time 0 where the mask is true, with other system seeds and start values.

        `seeds` and the arrays of `start` have n rows; only those of the mask count. What the
        plan and `start` do not give has its declared start value again.
        """

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Say which copies have failed since their reset, of shape (n,)."""

    def failure(self, row: int) -> ComponentFailed | None:
        """Say what failed in a copy."""

    def close(self) -> None:
        """Free everything; a second call does nothing."""
