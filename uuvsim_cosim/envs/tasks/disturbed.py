"""Target tracking with the disturbances of a real pool: delays, noise, weak thrusters.

Rewards and metrics are computed from the true positions, not from the measured ones. `randomise`
draws all disturbances, and the hull, for each episode: for training with domain randomisation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.distributions import Uniform
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation, Vary
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks.ranges import flag, within
from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking, tracking_system
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.orchestrator.shipped.tracking import LATENCY

__all__ = ["Disturbed"]

Array = NDArray[np.float64]

# What `randomise` draws, uniformly: factors on the hull's figures, and what a pool does.
ADDED_MASS, DRAG = (0.7, 1.3), (0.7, 1.3)
THRUST = (0.7, 1.1)
NOISE = (0.0, 0.01)  # m
LATE = (0.0, 0.4)  # s, of positions, and of commands


class Disturbed(TargetTracking):
    """Target tracking with disturbances, by default of one tracker, the vehicle pool8.

    `seen_late` [s] is the age of the positions of the vehicle and the target, `acted_late` [s] the
    delay of a command by radio, `noise` [m] the standard deviation of each position, and `thrust`
    the remaining share of the thrust, which is not observed. `randomise` draws all of these, drag
    and added mass for each episode. Other options are those of `TargetTracking`.
    """

    def __init__(
        self,
        n_trackers: int = 1,
        *,
        seen_late: float = 0.0,
        acted_late: float = 0.0,
        noise: float = 0.0,
        thrust: float = 1.0,
        randomise: bool = False,
        **options: Any,
    ) -> None:
        self.seen_late = within("seen_late [s]", seen_late, 0, LATENCY)
        self.acted_late = within("acted_late [s]", acted_late, 0, LATENCY)
        self.thrust = within("thrust", thrust, 1e-3, 2)
        self.randomise = flag("randomise", randomise)
        deviation = within("noise [m]", noise, 0, np.inf)
        if self.randomise:
            ranges = {"M_A": ADDED_MASS, "D_l": DRAG, "D_q": DRAG}
            hulls = Randomisation(
                Vary(f"tracker_{i}.hull.{name}_{k}{k}", Uniform(*ranges[name]), relative=True)
                for i in range(1, n_trackers + 1)
                for name in ranges
                for k in range(1, 7)
            )
            options.setdefault("randomisation", hulls)
        # A delay, so that the system always has links: all disturbances share one kernel.
        super().__init__(n_trackers, delay=LATENCY, **options)
        self.noise = deviation
        motion = "random_heading" if self.motion == "rest" else self.motion
        # Links that transmit in every tick, so that delays can be 0.
        self.system = tracking_system(
            self.n_trackers,
            vehicle=self.vehicle,
            motion=motion,
            obstacles=self.n_obstacles,
            links=True,
            link_period="0.02",
        )

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values: a start without collisions, and the disturbances."""
        n = draws.n
        start = dict(super().start(draws))
        seen, acted, noise, thrust = (
            np.full(n, x) for x in (self.seen_late, self.acted_late, self.noise, self.thrust)
        )
        if self.randomise:
            seen, acted = (draws.uniform(f"disturbed/{k}", *LATE) for k in ("seen", "acted"))
            noise = draws.uniform("disturbed/noise", *NOISE)
            thrust = draws.uniform("disturbed/thrust", *THRUST)
        Q_max = preset("thrusters", "pool8_jet", "thruster").number("Q_max", "m3/s")
        start["positioning.delay"] = seen
        start["positioning.sigma"] = np.repeat(noise[:, None], 3, axis=1)
        for agent in self.agents:
            start[f"{agent}.positioning.delay"] = seen
            start[f"{agent}.positioning.sigma"] = noise[:, None] * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
            start[f"{agent}.radio.delay"] = acted
            for i in range(1, 9):  # thrust goes with the square of the flow
                start[f"{agent}.thruster_{i}.Q_max"] = np.sqrt(thrust) * Q_max
        return start
