"""Shipped tasks: a vehicle at a pose, on a curve, or with disturbances; target tracking.

It may import `envs.episodes`, `envs.randomisation`, `envs.plants`, `envs.task`, `envs.pictures`.
Start reading with `pose.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.envs.tasks.altitude_following import AltitudeFollowing
    from uuvsim_cosim.envs.tasks.disturbance import DisturbanceRejection
    from uuvsim_cosim.envs.tasks.evaluation import evaluate
    from uuvsim_cosim.envs.tasks.scripted import scripted_policy
    from uuvsim_cosim.envs.tasks.station_keeping import StationKeeping
    from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking
    from uuvsim_cosim.envs.tasks.tracking_reward import TrackingRules
    from uuvsim_cosim.envs.tasks.trajectory import TrajectoryFollowing

__all__ = [
    "AltitudeFollowing",
    "DisturbanceRejection",
    "StationKeeping",
    "TargetTracking",
    "TrackingRules",
    "TrajectoryFollowing",
    "evaluate",
    "scripted_policy",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "AltitudeFollowing": "altitude_following",
        "DisturbanceRejection": "disturbance",
        "StationKeeping": "station_keeping",
        "TargetTracking": "target_tracking",
        "TrackingRules": "tracking_reward",
        "TrajectoryFollowing": "trajectory",
        "evaluate": "evaluation",
        "scripted_policy": "scripted",
    },
)
