"""The source `policy:FILE.npz`: a trained policy as a component, read where it lies."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlencode

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.sources import ModelSource

__all__ = ["source"]


def source(text: str, base: Path) -> ModelSource:
    """Resolve ``policy:FILE.npz`` or ``policy:FILE.npz?option=value``; the scheme's entry point.

    A file named from where one stands comes before one beside the system.
    """
    name, _, query = text.removeprefix("policy:").partition("?")
    given = Path(name).expanduser()
    for file in (given, base / given):
        if name and file.is_file():
            options = urlencode({"file": str(file.absolute())}, safe="/")
            return ModelSource(f"model:policy?{options}{'&' if query else ''}{query}")
    raise InputInvalid(f"source {text!r}: no such file; expected policy:FILE.npz")
