"""Disturbance rejection: stay where one is, while currents rise and thrusters fail."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Moment
from uuvsim_cosim.envs.tasks.ranges import whole, within
from uuvsim_cosim.envs.tasks.station_keeping import StationKeeping

__all__ = ["DisturbanceRejection"]

RAMPS = 3
THRUSTERS = 8


class DisturbanceRejection(StationKeeping):
    """Station keeping from close by, with steps and ramps of the current and weak thrusters.

    Drawn are: three changes of the current, of up to `gust` m/s in any direction, each as often a
    step as a ramp of 1 to 5 s; and up to `faults` thrusters, each of which at some time loses 30
    to 100 % of its thrust, unknown to the allocation. `privileged` adds their health (8).
    """

    def __init__(
        self, *, gust: float = 0.3, faults: int = 1, away: float = 0.3, **options: Any
    ) -> None:
        self.gust = within("gust [m/s]", gust, 0, np.inf)
        self.faults = whole("faults", faults, 0, THRUSTERS)
        super().__init__(disturbances=True, signals=("faults.health",), away=away, **options)

    def hidden(self, m: Moment, R: Array) -> list[Array]:
        """Return each thruster's share of its thrust."""
        return [m["faults.health"]]

    def hidden_limits(self) -> list[float]:
        """Return their limits."""
        return [2.0] * THRUSTERS

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Draw what will go wrong, and when."""
        n, end = draws.n, float(self.horizon)
        angle = draws.uniform("gust/direction", -np.pi, np.pi, (RAMPS,))
        size = draws.uniform("gust/size", 0.0, self.gust, (RAMPS,))
        level = np.stack([size * np.cos(angle), size * np.sin(angle), 0.0 * size], axis=2)
        ramp = draws.uniform("gust/ramp", -1.0, 1.0, (RAMPS,))
        # A whole number of faults, the thrusters that are hit in an order drawn for each episode.
        order = np.argsort(draws.uniform("fault/order", shape=(THRUSTERS,)), axis=1)
        rank = np.argsort(order, axis=1)
        count = np.floor(draws.uniform("fault/count", 0, self.faults + 1))
        left = draws.uniform("fault/left", 0.0, 0.7, (THRUSTERS,))
        return {
            **super().start(draws),
            "ramps.dv": level,
            "ramps.t": draws.uniform("gust/time", 0.0, end, (RAMPS,)),
            "ramps.T": np.where(ramp < 0, 1e-3, 1.0 + 4.0 * np.abs(ramp)),
            "faults.efficiency": np.where(rank < count[:, None], left, np.ones((n, THRUSTERS))),
            "faults.t": draws.uniform("fault/time", 0.0, end, (THRUSTERS,)),
        }
