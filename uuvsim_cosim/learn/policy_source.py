"""The source `policy:FILE.npz`: a trained policy as a component, read where it lies."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import urlencode

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.loading import policy_path
from uuvsim_cosim.orchestrator.sources import ModelSource

__all__ = ["source"]


def source(text: str, base: Path) -> ModelSource:
    """Resolve ``policy:FILE.npz`` or ``policy:FILE.npz?option=value``; the scheme's entry point.

    One that ships may be given by its name, ``policy:source_sac``. A file named from where one
    stands comes before one beside the system.
    """
    name, _, query = text.removeprefix("policy:").partition("?")
    given = Path(name).expanduser()
    for file in (given, base / given):
        if name and file.is_file():
            return _model(file, query)
    try:
        file = policy_path(name)
        if not file.is_file():
            raise InputInvalid(f"{name!r}: is a folder; expected policy:FILE.npz")
    except InputInvalid as error:
        raise InputInvalid(f"source {text!r}: {error}") from None
    return _model(file, query)


def _model(file: Path, query: str) -> ModelSource:
    options = urlencode({"file": str(file.absolute())}, safe="/")
    return ModelSource(f"model:policy?{options}{'&' if query else ''}{query}")
