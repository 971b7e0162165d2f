"""Options of a declaration: structural choices, as Python or a system's file writes them."""

from __future__ import annotations

from uuvsim_cosim.errors import InputInvalid

__all__ = ["is_on"]


def is_on(name: str, value: bool | str, *further: str) -> bool:
    """Read an option that is true or false; raises InputInvalid, which lists `further` too."""
    text = str(value).lower()
    if text not in ("true", "false", "1", "0"):
        raise InputInvalid(f"{name}={value!r}", ", ".join(("true", "false", *further)))
    return text in ("true", "1")
