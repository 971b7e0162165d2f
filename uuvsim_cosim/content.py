"""Paths of the content folders (models, fmus, orchestrator): in the wheel or the checkout."""

from __future__ import annotations

from pathlib import Path

__all__ = ["content"]

_PACKAGE = Path(__file__).resolve().parent


def content(*parts: str) -> Path:
    """Return the path of a content file or folder, e.g. ``content("models", "vehicles")``."""
    installed = _PACKAGE / "_content"
    root = installed if installed.is_dir() else _PACKAGE.parent
    return root.joinpath(*parts)
