"""The page of the HTTP server: live values, plots, buttons, and a pilot's keys and gamepad."""

from __future__ import annotations

from pathlib import Path

__all__ = ["page"]


def page() -> str:
    """Return the page, one file of HTML that loads nothing else."""
    return Path(__file__).with_name("page.html").read_text(encoding="utf-8")
