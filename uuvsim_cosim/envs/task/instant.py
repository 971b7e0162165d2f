"""A moment of n episodes: signals at the end of an action, or after a reset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.signals import Signals

__all__ = ["Instant", "mixed"]

Array = NDArray[np.float64]
T = TypeVar("T", bound=np.generic)


def mixed(old: NDArray[T], new: NDArray[T], rows: NDArray[np.intp]) -> NDArray[T]:
    """Copy values (…, n) of all environments, with the new ones of some."""
    both = old.copy()
    both[..., rows] = new[..., rows]
    return both


@final
class Instant:
    """The `Moment` protocol over an array of signals, of shape (size, n)."""

    __slots__ = ("_before", "_fresh", "_seconds", "_signals", "action", "start", "step", "values")

    def __init__(
        self,
        signals: Signals,
        values: Array,
        step: NDArray[np.int64],
        seconds: tuple[int, int],
        action: Mapping[str, Array],
        start: Mapping[str, Array],
        before: Instant | None = None,
        fresh: NDArray[np.intp] | None = None,
    ) -> None:
        values.flags.writeable = False
        self._signals = signals
        self.values = values
        self.step = step
        self._seconds = seconds  # of an action, as numerator and denominator
        self.action = action
        self.start = start
        self._before = before
        self._fresh = fresh  # episodes that have begun since `before`

    @property
    def n(self) -> int:
        """The number of environments."""
        return len(self.step)

    @property
    def time(self) -> Array:
        """The seconds since the reset, of shape (n,)."""
        numerator, denominator = self._seconds
        return np.asarray(self.step * numerator / denominator)

    @property
    def before(self) -> Instant:
        """The moment when the action began; after a reset this moment itself."""
        if self._before is None:
            return self
        if self._fresh is not None:
            old, fresh = self._before, self._fresh
            self._before = Instant(
                self._signals,
                mixed(old.values, self.values, fresh),
                mixed(old.step, self.step, fresh),
                self._seconds,
                {k: mixed(a.T, self.action[k].T, fresh).T for k, a in old.action.items()},
                self.start,
            )
            self._fresh = None
        return self._before

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a signal of the task, in the variable's own unit, of shape (n, *shape)."""
        return self._signals.view(self.values, name)

    def alone(self) -> Instant:
        """Forget the moment before, so that no chain of moments is kept in memory."""
        self._before = self._fresh = None
        return self
