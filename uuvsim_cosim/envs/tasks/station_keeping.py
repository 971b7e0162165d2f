"""Station keeping: stay at one place, with one heading, in a current."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Symbols
from uuvsim_cosim.envs.task.task import Array, Moment
from uuvsim_cosim.envs.tasks.pose import PoseTask
from uuvsim_cosim.envs.tasks.ranges import within

__all__ = ["StationKeeping"]


class StationKeeping(PoseTask):
    """Stay at N = E = 0, D = 10 m with heading north, in a current.

    Each episode draws the start position, up to `away` m from the goal along each axis, the
    heading, the velocity, up to 0.2 m/s along each axis, and the mean current. Reward, observation
    and other options are those of all tasks with a wanted pose (`PoseTask`,
    docs/learning/tasks.md).
    """

    GOAL = (0.0, 0.0, 10.0, 0.0)

    def __init__(self, *, away: float = 1.5, **options: Any) -> None:
        super().__init__(**options)
        self.away = within("away [m]", away, 0, np.inf)

    def wanted(self, m: Moment) -> Array:
        """Return the goal, of shape (n, 4)."""
        return np.tile(self.GOAL, (m.n, 1))

    def expressions(self, m: Symbols) -> Mapping[str, Any] | None:
        """Return the expressions of the task, which has no privileged observations."""
        return self.pose_expressions(m, self.GOAL)

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values: pose, velocity and current."""
        pose = np.zeros((draws.n, 6))
        pose[:, :3] = self.GOAL[:3] + draws.uniform("start/p", -self.away, self.away, (3,))
        pose[:, 5] = draws.uniform("start/psi", -np.pi, np.pi)
        speed = np.zeros((draws.n, 6))
        speed[:, :3] = draws.uniform("start/nu", -0.2, 0.2, (3,))
        return {**self.at(draws, pose), "hull.nu_0": speed, **super().start(draws)}
