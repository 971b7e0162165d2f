"""The four scenarios of target tracking, each of which prepares for the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking

__all__ = ["SCENARIOS", "source", "target", "transition_1", "transition_2"]


def source(**options: Any) -> TargetTracking:
    """Source scenario: one tracker goes to a target at rest."""
    return TargetTracking(**{"n_trackers": 1, "n_obstacles": 0, "motion": "rest", **options})


def transition_1(**options: Any) -> TargetTracking:
    """Transition 1: one tracker follows a moving target."""
    return TargetTracking(**{"n_trackers": 1, "n_obstacles": 0, **options})


def transition_2(**options: Any) -> TargetTracking:
    """Transition 2: two trackers that cooperate follow a moving target."""
    return TargetTracking(**{"n_trackers": 2, "n_obstacles": 0, **options})


def target(**options: Any) -> TargetTracking:
    """Target scenario: two trackers follow a moving target among two obstacles."""
    return TargetTracking(**{"n_trackers": 2, "n_obstacles": 2, **options})


SCENARIOS: dict[str, Callable[..., TargetTracking]] = {
    "source": source,
    "transition_1": transition_1,
    "transition_2": transition_2,
    "target": target,
}
