"""Interface of a learner: it acts, learns from transitions, and can be saved and restored."""

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
    """Learning algorithm for the experience of n environments with N agents.

    Its random numbers depend on its seed only: equal seeds and transitions give equal bits on one
    thread. Call `act` and `learn` in turn: some learners keep the drawn actions in between.
    """

    @property
    def name(self) -> str:
        """The name of the algorithm, as on the command line: "masac"."""

    @property
    def settings(self) -> Mapping[str, float]:
        """All settings by name; they are saved with the policies."""

    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return actions (n, N, a) in [-1, 1] for observations (n, N, d)."""

    def learn(self, transitions: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Learn from a step of all environments; return the losses, or {} without an update.

        `over` (n,) marks the environments whose episode ended. Raises LearningDiverged if a loss or
        a gradient is not finite.
        """

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return the kind and the tensors of one agent's `Policy`."""

    def state(self) -> State:
        """Return the whole state: networks, optimisers, buffers, random number generators."""

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for one of another shape."""


class Transferable(Learner, Protocol):
    """Learner that can continue in another task with the networks of the previous task."""

    def go_on_from(self, last: Self, seed: int) -> None:
        """Copy the networks of `last`, so that the actions are exactly unchanged.

        Observed numbers that were always zero for `last` have no effect at first. Agent i starts as
        a copy of agent i mod N of `last`. Optimisers, buffers and random number generators are not
        copied. Raises InputInvalid for networks of other shapes.
        """
