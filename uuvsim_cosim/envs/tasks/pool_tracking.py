"""Transition 1 in the system `pool_tracking`: a policy observes the vehicle's own estimates.

Rewards and metrics are computed from the true positions of the tracker and of the target, the
component `quarry`. A policy observes the pose that the navigation estimates, one tick old, and the
target's position of the predictor. Its actions go directly to the pilot, since the policy runs on
board.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Channel, Moment, Symmetry
from uuvsim_cosim.envs.tasks.ranges import flag, within
from uuvsim_cosim.envs.tasks.target_tracking import A_MAX, OMEGA_MAX, TargetTracking
from uuvsim_cosim.envs.tasks.tracking_observation import Seen
from uuvsim_cosim.envs.tasks.tracking_reward import Scene
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.orchestrator.shipped.pool import PACKET, pool_tracking
from uuvsim_cosim.orchestrator.shipped.tracking import DEPTH, NOISE

__all__ = ["PoolTracking"]

FIXED = ("n_trackers", "n_obstacles", "vehicle", "delay", "knowledge_range", "arena")
ESTIMATE = (0.02, 0.02, 0.01, 0.0, 0.0, 0.03)  # deviations of the estimated start, m, rad


class PoolTracking(TargetTracking):
    """Target tracking of one tracker and one target in the simulated pool of figure 11.

    `noise` [m] is the standard deviation of the external positions, `loss` the share of lost radio
    packets, and `thrust` the remaining share of the thrust. With `predicted`, the policy observes
    the predicted position of the target, otherwise that of the radio's last packet. Other options
    are those of `TargetTracking`, except those that the system decides.
    """

    def __init__(
        self,
        *,
        noise: float = NOISE,
        loss: float = PACKET["loss"],
        thrust: float = 1.0,
        predicted: bool = True,
        **options: Any,
    ) -> None:
        fixed = [name for name in FIXED if name in options]
        if fixed:
            raise InputInvalid("PoolTracking", f"{fixed[0]}: the system's own", "no such option")
        super().__init__(1, **options)
        self.noise, self.loss = within("noise [m]", noise, 0, np.inf), within("loss", loss, 0, 1)
        self.thrust = within("thrust", thrust, 1e-3, 2)
        self.predicted = flag("predicted", predicted)
        motion = "random_heading" if self.motion == "rest" else self.motion
        self.system = _system("model:pilot?vehicle=pool8&period=1/50", motion)
        self.actions = {
            "tracker_1": (
                Channel("pilot.a", -A_MAX, A_MAX, "m/s2"),
                Channel("pilot.omega", -OMEGA_MAX, OMEGA_MAX, "rad/s"),
            )
        }
        self.signals = (
            *("hull.eta", "hull.nu", "navigation.eta", "navigation.nu", "pilot.nu_d"),
            *("quarry.hull.eta", "predictor.now", "radio.y_2", "radio.valid_2"),
        )

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values: a start without collisions, and an estimate of it with errors."""
        n, size = draws.n, np.array(self.arena.size)
        drawn = super().start(draws)
        pose = drawn["tracker_1.hull.eta_0"]
        quarry = np.zeros((n, 6))
        quarry[:, :3] = drawn["target.position_0"]
        quarry[:, 5] = drawn["target.psi_0"]
        flow = preset("thrusters", "pool8_jet", "thruster").number("Q_max", "m3/s")
        return {
            **{k: v for k, v in drawn.items() if k.startswith("target.")},
            "hull.eta_0": pose,
            "navigation.eta_0": pose + draws.normal("task/estimate", (6,)) * ESTIMATE,
            "quarry.hull.eta_0": quarry,
            "predictor.position_0": drawn["target.position_0"],
            "pilot.depth": np.full(n, DEPTH),
            "pool.size": np.tile(size, (n, 1)),
            "positioning.sigma": np.full((n, 6), self.noise),
            "radio.loss": np.full(n, self.loss),
            **{f"thruster_{i}.Q_max": np.full(n, flow * self.thrust**0.5) for i in range(1, 9)},
        }

    def symmetries(self) -> tuple[Symmetry, ...]:
        """Return (): the positions of the sensors have no symmetry."""
        return ()

    def state(self, m: Moment) -> Array:
        """Return the state, equation (5), of the true positions."""
        eta, nu = m["hull.eta"], m["hull.nu"]
        flat = np.concatenate([eta[:, [0, 1, 5]], nu[:, [0, 1, 5]], m["quarry.hull.eta"][:, :2]], 1)
        low, high = self.state_limits()
        return np.asarray(np.clip(flat, low, high))

    # ---- inside ---------------------------------------------------------------------------

    def _scene(self, m: Moment) -> Scene:
        none = np.zeros((m.n, 0, 3))
        tracker, quarry = m["hull.eta"][:, None, :2], m["quarry.hull.eta"][:, :2]
        return Scene(tracker, quarry, none, np.zeros((m.n, 0), bool))

    def _seen(self, m: Moment) -> Seen:
        return Seen(
            eta=m["navigation.eta"][:, None],
            nu=m["navigation.nu"][:, None],
            u_d=m["pilot.nu_d"][:, None, 0],
            target=self._where(m)[:, None],
            target_before=self._where(m.before)[:, None],
            known=np.ones((m.n, 1), bool),
            obstacles=np.zeros((m.n, 0, 3)),
            reaches=np.zeros((m.n, 0), bool),
        )

    def _where(self, m: Moment) -> Array:
        if self.predicted:
            return m["predictor.now"][:, :2]
        heard = m["radio.valid_2"].astype(bool)[:, None]
        return np.where(heard, m["radio.y_2"][:, 3:5], m["predictor.now"][:, :2])


# Equal arguments give the same system, so that its kernel is made once.
_system = lru_cache(maxsize=4)(pool_tracking)
