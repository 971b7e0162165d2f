"""Reason why a training has changed no actor: it was too short for an update."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["taught_nothing"]

BEFORE = ("samples", "warm_up", "batch")  # environment steps without an update


def taught_nothing(settings: Mapping[str, float], steps: int, updates: int | None) -> str | None:
    """Return the reason why no actor was updated; None if one was, or if `updates` is unknown.

    `settings` are a learner's; it made `updates` updates in `steps` environment steps.
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
