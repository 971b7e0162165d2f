"""The watchdog: the time limit for an answer of a component in a separate process."""

from __future__ import annotations

from threading import TIMEOUT_MAX

from uuvsim_cosim.errors import InputInvalid

__all__ = ["check_watchdog"]


def check_watchdog(seconds: float, what: str = "watchdog") -> None:
    """Check a time limit; raises InputInvalid."""
    if not 0.0 < seconds <= TIMEOUT_MAX:
        raise InputInvalid(f"{what} {seconds:g}: expected more than 0 seconds, such as 30")
