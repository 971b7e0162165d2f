"""Options of tasks are refused, with what would be right, where they are out of range."""

from __future__ import annotations

from uuvsim_cosim.errors import InputInvalid

__all__ = ["within"]


def within(name: str, value: float, low: float, high: float) -> None:
    """Raise InputInvalid unless low <= value <= high."""
    if not low <= value <= high:
        raise InputInvalid(f"{name}: {value}; expected {low:g} to {high:g}")
