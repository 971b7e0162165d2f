"""What learns, behind one interface: it acts, it is told what came of it, it can be kept."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions

if TYPE_CHECKING:
    from uuvsim_cosim.learn.algorithms.checkpoint import State

__all__ = ["Learner", "Transferable"]

Array = NDArray[np.float32]


class Learner(Protocol):
    """An algorithm on the experience of n environments with N agents.

    All it draws comes from its seed: equal seeds and experience give equal bits on one thread.
    """

    @property
    def name(self) -> str:
        """The algorithm, as on the command line: "masac"."""

    @property
    def settings(self) -> Mapping[str, float]:
        """All numbers that it was given, for the record."""

    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return actions (n, N, a) in [-1, 1] of observations (n, N, d)."""

    def learn(self, lived: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Take in a step of all environments, and learn; gives losses, or nothing.

        `over` (n,) says whose episode ended. Raises LearningDiverged for a NaN.
        """

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return the kind and the tensors of one agent's `Policy`."""

    def state(self) -> State:
        """Return all that learning goes on from: networks, optimisers, buffers, random numbers."""

    def set_state(self, state: State) -> None:
        """Go on from what `state` gave; raises InputInvalid for one of another shape."""


class Transferable(Learner, Protocol):
    """A learner that goes on in another task with what it has learned in the last one."""

    def go_on_from(self, last: Self, seed: int) -> None:
        """Act exactly as `last` does, as long as nothing is observed that it never saw.

        Agent i begins as a copy of agent i mod N of `last`. Optimisers, buffers and random numbers
        stay as they are. Raises InputInvalid for networks of other shapes.
        """
