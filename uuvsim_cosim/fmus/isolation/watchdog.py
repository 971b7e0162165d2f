"""The watchdog: how long a component in a process of its own has to answer."""

from __future__ import annotations

from threading import TIMEOUT_MAX

from uuvsim_cosim.errors import InputInvalid

__all__ = ["check_watchdog"]


def check_watchdog(seconds: float, what: str = "watchdog") -> None:
    """Refuse what is no time to answer in; raises InputInvalid."""
    if not 0.0 < seconds <= TIMEOUT_MAX:
        raise InputInvalid(f"{what} {seconds:g}: expected more than 0 seconds, such as 30")
