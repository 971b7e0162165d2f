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
    """An algorithm on the experience of n environments with N agents.

    Its random numbers come from its seed: equal seeds and transitions give equal bits on one
    thread. Each `learn` follows the `act` whose actions led to its transitions, since some
    learners keep the drawn actions in between.
    """

    @property
    def name(self) -> str:
        """The name of the algorithm, as on the command line: "masac"."""

    @property
    def settings(self) -> Mapping[str, float]:
        """All settings, which are saved with the policies."""

    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return actions (n, N, a) in [-1, 1] of observations (n, N, d)."""

    def learn(self, transitions: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Learn from a step of all environments; returns losses, or nothing without an update.

        `over` (n,) marks the environments whose episode ended. Raises LearningDiverged for NaN.
        """

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return the kind and the tensors of one agent's `Policy`."""

    def state(self) -> State:
        """Return the state of learning: networks, optimisers, buffers, random numbers."""

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for one of another shape."""


class Transferable(Learner, Protocol):
    """A learner that can continue in another task with the networks of the last one."""

    def go_on_from(self, last: Self, seed: int) -> None:
        """Copy the networks of `last`, so that the actions are exactly unchanged.

        Numbers of the observation that were always zero for `last` have no effect at first. Agent
        i begins as a copy of agent i mod N of `last`. Optimisers, buffers and random numbers are
        not copied. Raises InputInvalid for networks of other shapes.
        """
