"""Why a training has taught nothing: it was too short for an update."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["taught_nothing"]

BEFORE = ("samples", "warm_up", "batch")  # environment steps without an update


def taught_nothing(settings: Mapping[str, float], steps: int, updates: int | None) -> str | None:
    """Say why no actor is other than at the start; None, where one is, or `updates` is not known.

    `settings` are a learner's, `updates` those that it made in `steps` environment steps.
    """
    if updates is None:
        return None
    late = int(settings.get("critic_only", 0))
    if updates and updates > late:
        return None
    if updates:
        return (
            f"no actor was updated: critic_only is {late}, updates made {updates}; expected more "
            "steps, or a lower critic_only"
        )
    value, name = max((int(settings.get(name, 0)), name) for name in BEFORE)
    if value > steps:
        return (
            f"no update was made: {name} is {value}, steps {steps}; expected at least {value} "
            f"steps, or a lower {name}"
        )
    return (
        f"no update was made: updates is {settings.get('updates', 0):g} for each step of all "
        f"environments, steps {steps}; expected more of them"
    )
