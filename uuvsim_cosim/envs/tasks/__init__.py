"""Tasks that ship: a vehicle at a pose, on a curve, against disturbances; target tracking."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uuvsim_cosim.envs.tasks.altitude_following import AltitudeFollowing
    from uuvsim_cosim.envs.tasks.disturbance import DisturbanceRejection
    from uuvsim_cosim.envs.tasks.evaluation import evaluate
    from uuvsim_cosim.envs.tasks.scripted import scripted_policy
    from uuvsim_cosim.envs.tasks.station_keeping import StationKeeping
    from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking
    from uuvsim_cosim.envs.tasks.tracking_rules import TrackingRules
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

_HOME = {
    "AltitudeFollowing": "altitude_following",
    "DisturbanceRejection": "disturbance",
    "StationKeeping": "station_keeping",
    "TargetTracking": "target_tracking",
    "TrackingRules": "tracking_rules",
    "TrajectoryFollowing": "trajectory",
    "evaluate": "evaluation",
    "scripted_policy": "scripted",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    from importlib import import_module

    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value
