"""Replay buffer: the last transitions of a team, sampled uniformly; sums of several rewards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Symmetry
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.learn.algorithms.checkpoint import State

__all__ = ["NStep", "Replay", "Transitions", "seen_by"]

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Transitions:
    """Batch of n transitions of N agents; the end by a time limit is not a termination."""

    observation: Array  # (n, N, d)
    action: Array  # (n, N, a), in [-1, 1]
    reward: Array  # (n, N)
    after: Array  # (n, N, d), the next observation, or the last one of an episode that ended
    terminated: Array  # (n, N), 1 if the task terminated the agent's episode


def seen_by(
    given: Transitions, symmetries: Sequence[Symmetry], random: np.random.Generator
) -> Transitions:
    """Return each transition unchanged or as the image under a symmetry, with equal probability."""
    which = random.integers(0, 1 + len(symmetries), len(given.reward))
    o, a = (
        np.stack(
            [np.ones_like(getattr(symmetries[0], k)), *(getattr(s, k) for s in symmetries)]
        ).astype(np.float32)[which][:, None]
        for k in ("observation", "action")
    )
    return replace(
        given, observation=given.observation * o, action=given.action * a, after=given.after * o
    )


@final
class Replay:
    """Buffer of the last `size` transitions; new ones replace the oldest ones."""

    def __init__(self, size: int, agents: int, observed: int, acted: int) -> None:
        shapes = [(observed,), (acted,), (), (observed,), ()]
        self._rows = {
            f.name: np.zeros((size, agents, *shape), np.float32)
            for f, shape in zip(fields(Transitions), shapes, strict=True)
        }
        self.size, self.count, self._next = size, 0, 0

    def add(self, given: Transitions) -> None:
        """Add transitions; a full buffer loses its oldest ones.

        Raises InputInvalid for more transitions than fit into the buffer.
        """
        n = len(given.reward)
        if n > self.size:
            raise InputInvalid(f"buffer of {self.size}", f"{n} at once", f"at least {n}")
        at = (self._next + np.arange(n)) % self.size
        for name, rows in self._rows.items():
            rows[at] = getattr(given, name)
        self._next = (self._next + n) % self.size
        self.count = min(self.count + n, self.size)

    def draw(
        self, n: int, random: np.random.Generator, symmetries: Sequence[Symmetry] = ()
    ) -> Transitions:
        """Draw n transitions with replacement, unchanged or as images under `symmetries`."""
        at = random.integers(0, self.count, n)
        drawn = Transitions(**{name: rows[at] for name, rows in self._rows.items()})
        return seen_by(drawn, symmetries, random) if symmetries else drawn

    def awake(self) -> NDArray[np.bool_]:
        """Return which numbers of the observations have ever been nonzero, of shape (d,)."""
        kept = (self._rows[name][: self.count] for name in ("observation", "after"))
        seen, after = ((rows != 0).any(axis=(0, 1)) for rows in kept)
        return np.asarray(seen | after)

    def state(self) -> dict[str, Any]:
        """Return the stored transitions as arrays by name."""
        kept = {name: rows[: self.count].copy() for name, rows in self._rows.items()}
        return {**kept, "next": self._next}

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for another shape."""
        self.count, self._next = len(state["reward"]), int(state["next"])
        for name, rows in self._rows.items():
            if len(state[name]) > self.size or state[name].shape[1:] != rows.shape[1:]:
                raise InputInvalid(
                    f"buffer {name!r} of shape {state[name].shape}", f"at most {rows.shape}"
                )
            rows[: self.count] = state[name]


@final
class NStep:
    """Transitions over several actions: the sum of the rewards of `count` steps.

    With the rewards r_0 … r_(K-1), where K is `count`, or less if the episode ends before, the
    transition of each environment is

        reward = sum_k gamma^k r_k,    gamma (1 - terminated) = gamma^K (1 - terminated_(K-1))

    so that a learner learns from K steps with the equation for one step.
    """

    def __init__(self, count: int, gamma: float) -> None:
        self.count, self.gamma = count, gamma
        self._kept: list[tuple[Transitions, NDArray[np.bool_]]] = []

    def __call__(self, transitions: Transitions, over: NDArray[np.bool_]) -> Transitions | None:
        """Add a step of n environments; return the transition that began `count` - 1 steps ago.

        Returns None until there are `count` steps.
        """
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
        """Return the steps whose transitions are not complete yet."""
        names = [f.name for f in fields(Transitions)]
        return [{**{k: getattr(t, k) for k in names}, "over": over} for t, over in self._kept]

    def set_state(self, state: Sequence[State]) -> None:
        """Restore a state."""
        self._kept = [
            (Transitions(**{k: v for k, v in row.items() if k != "over"}), row["over"])
            for row in state
        ]
