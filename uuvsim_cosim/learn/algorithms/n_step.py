"""Transitions over several actions: the rewards on the way, discounted, and where it led."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions

if TYPE_CHECKING:
    from uuvsim_cosim.learn.algorithms.checkpoint import State

__all__ = ["NStep"]


@final
class NStep:
    """Makes of the last `count` steps one transition for each environment, or fewer at an end.

    Of rewards r_0 … r_(K-1), K <= count the steps until the episode was over:

        reward = sum_k gamma^k r_k,    gamma (1 - terminated) = gamma^K (1 - terminated_(K-1))

    so that a learner of one step learns from K steps with the same equation.
    """

    def __init__(self, count: int, gamma: float) -> None:
        self.count, self.gamma = count, gamma
        self._kept: list[tuple[Transitions, NDArray[np.bool_]]] = []

    def __call__(self, transitions: Transitions, over: NDArray[np.bool_]) -> Transitions | None:
        """Add a step of n environments; returns the transition of `count` - 1 steps ago, if any."""
        self._kept.append((transitions, np.array(over, bool)))
        if len(self._kept) < self.count:
            return None
        first = self._kept[0][0]
        reward, after = np.zeros_like(first.reward), first.after.copy()
        alive = np.ones_like(first.reward)  # gamma^(K-1) (1 - terminated)
        goes_on, discount = np.ones(len(over), bool), 1.0
        for step, ended in self._kept:
            rows = goes_on
            reward[rows] += np.float32(discount) * step.reward[rows]
            after[rows] = step.after[rows]
            alive[rows] = np.float32(discount) * (1.0 - step.terminated[rows])
            discount *= self.gamma
            goes_on = goes_on & ~ended
        self._kept.pop(0)
        return Transitions(first.observation, first.action, reward, after, 1.0 - alive)

    def state(self) -> list[dict[str, object]]:
        """Return the steps that wait for their rewards."""
        names = [f.name for f in fields(Transitions)]
        return [{**{k: getattr(t, k) for k in names}, "over": over} for t, over in self._kept]

    def set_state(self, state: Sequence[State]) -> None:
        """Restore a state."""
        self._kept = [
            (Transitions(**{k: v for k, v in row.items() if k != "over"}), row["over"])
            for row in state
        ]
