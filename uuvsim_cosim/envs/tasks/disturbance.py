"""Disturbance rejection: stay at one place while the current changes and thrusters fail."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Symbols
from uuvsim_cosim.envs.task.task import Array, Moment
from uuvsim_cosim.envs.tasks.ranges import whole, within
from uuvsim_cosim.envs.tasks.station_keeping import StationKeeping

__all__ = ["DisturbanceRejection"]

RAMPS = 3
THRUSTERS = 8


class DisturbanceRejection(StationKeeping):
    """Station keeping from a close start, with changes of the current and failing thrusters.

    Each episode draws three changes of the current by up to `gust` m/s in any direction; each is a
    step or, with equal probability, a ramp of 1 to 5 s. It also draws up to `faults` thrusters,
    each of which loses 30 to 100 % of its thrust at some time; the allocation does not know this.
    With `privileged`, the observation includes the health of the thrusters (8). Reward and other
    options are those of `StationKeeping`.
    """

    def __init__(
        self, *, gust: float = 0.3, faults: int = 1, away: float = 0.3, **options: Any
    ) -> None:
        self.gust = within("gust [m/s]", gust, 0, np.inf)
        self.faults = whole("faults", faults, 0, THRUSTERS)
        super().__init__(disturbances=True, signals=("faults.health",), away=away, **options)

    def hidden(self, m: Moment, R: Array) -> list[Array]:
        """Return the remaining share of each thruster's thrust, of shape (n, 8)."""
        return [m["faults.health"]]

    def expressions(self, m: Symbols) -> Mapping[str, Any] | None:
        """Return the expressions of station keeping: the health is a privileged observation."""
        return super().expressions(m)

    def hidden_limits(self) -> list[float]:
        """Return the limits of the numbers of `hidden`."""
        return [2.0] * THRUSTERS

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return the start values, with the changes of the current and the thruster faults."""
        n, end = draws.n, float(self.horizon)
        angle = draws.uniform("gust/direction", -np.pi, np.pi, (RAMPS,))
        size = draws.uniform("gust/size", 0.0, self.gust, (RAMPS,))
        level = np.stack([size * np.cos(angle), size * np.sin(angle), 0.0 * size], axis=2)
        ramp = draws.uniform("gust/ramp", -1.0, 1.0, (RAMPS,))
        # A whole number of faults; the failing thrusters are drawn for each episode.
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
