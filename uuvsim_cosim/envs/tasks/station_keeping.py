"""Station keeping: stay at one place, with one heading, in a current."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Moment
from uuvsim_cosim.envs.tasks.pose import PoseTask
from uuvsim_cosim.envs.tasks.ranges import within

__all__ = ["StationKeeping"]


class StationKeeping(PoseTask):
    """Stay at N = E = 0, D = 10 m, heading north; the start is up to `away` m off and at any heading.

    An episode draws the offset, uniform in a box, the heading, nu up to 0.2 m/s, the mean current.
    """  # noqa: E501

    GOAL = (0.0, 0.0, 10.0, 0.0)

    def __init__(self, *, away: float = 1.5, **options: Any) -> None:
        super().__init__(**options)
        self.away = within("away [m]", away, 0, np.inf)

    def wanted(self, m: Moment) -> Array:
        """Return the goal, n times."""
        return np.tile(self.GOAL, (m.n, 1))

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Draw where and how the vehicle begins."""
        pose = np.zeros((draws.n, 6))
        pose[:, :3] = self.GOAL[:3] + draws.uniform("start/p", -self.away, self.away, (3,))
        pose[:, 5] = draws.uniform("start/psi", -np.pi, np.pi)
        speed = np.zeros((draws.n, 6))
        speed[:, :3] = draws.uniform("start/nu", -0.2, 0.2, (3,))
        return {**self.at(draws, pose), "hull.nu_0": speed, **super().start(draws)}
