"""The tasks that ship keep what environments promise: the suite that ships for outsiders."""

from __future__ import annotations

import pytest

from uuvsim_cosim.envs.conformance.suite import check
from uuvsim_cosim.envs.tasks.tracking_scenarios import target, transition_2
from uuvsim_cosim.envs.team import CosimParallelEnv

IDS = [
    "AltitudeFollowing",
    "StationKeeping",
    "TrajectoryFollowing",
    "DisturbanceRejection",
    "TargetTracking",
    "TargetTrackingSource",
    "TargetTrackingTransition1",
    "TargetTrackingTransition2",
    "TargetTrackingTarget",
]


@pytest.mark.parametrize("id", IDS)
def test_an_id_keeps_every_promise(id: str) -> None:
    check(f"uuvsim/{id}-v0", steps=30)


@pytest.mark.parametrize("scenario", [transition_2, target])
def test_a_team_keeps_every_promise(scenario: object) -> None:
    check(lambda: CosimParallelEnv(scenario()), steps=30)  # type: ignore[operator]
