"""What a critic may know and a vehicle cannot: a task that shows the drawn parameters as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.draws import Draws
from uuvsim_cosim.envs.randomisation import Randomisation
from uuvsim_cosim.envs.task import Moment, Task
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.envs.picture import View

__all__ = ["with_privileged"]

Array = NDArray[np.float64]


def with_privileged(task: Task) -> PrivilegedTask:
    """Give a task whose observation ends with the drawn parameters, scaled by their range.

    These are its last `privileged_width` numbers, so that an actor can be kept from seeing them.
    Raises InputInvalid if the task draws nothing by a Randomisation.
    """
    return PrivilegedTask(task)


@final
class PrivilegedTask(Task):
    """Another task, with `extra` longer by what its Randomisation draws."""

    def __init__(self, task: Task) -> None:
        drawn = task.randomisation
        if not isinstance(drawn, Randomisation):
            raise InputInvalid(
                f"{type(task).__name__}: draws nothing by a Randomisation; expected a task with one"
            )
        self.task = task
        self.drawn = drawn.bound(task.system)
        self.privileged_width = len(self.drawn.privileged_names)
        super().__init__(
            task.system,
            actions=task.actions,
            observations=task.observations,
            action_step=task.action_step,
            horizon=task.horizon,
            signals=task.signals,
            randomisation=self.drawn,
        )

    def extra(self, m: Moment) -> Array:
        """Give the task's own, then the drawn parameters."""
        own = self.task.extra(m)
        seen = self.drawn.privileged(m.start)
        return seen if own is None else np.concatenate([own, seen], axis=1)

    @property
    def extra_limits(self) -> tuple[Sequence[float], Sequence[float]]:
        """Give the task's own, then -1 and 1."""
        low, high = self.task.extra_limits
        least, most = self.drawn.privileged_limits
        return [*low, *least.tolist()], [*high, *most.tolist()]

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Draw what the task draws."""
        return self.task.start(draws)

    def reward(self, m: Moment) -> Array:
        """Give the task's reward."""
        return self.task.reward(m)

    def terminated(self, m: Moment) -> NDArray[np.bool_]:
        """Say what the task says."""
        return self.task.terminated(m)

    def info(self, m: Moment) -> Mapping[str, NDArray[Any]]:
        """Give the task's info."""
        return self.task.info(m)

    def view(self, m: Moment, row: int) -> View | None:
        """Draw what the task draws."""
        return self.task.view(m, row)
