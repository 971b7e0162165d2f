"""Libraries of the extra `scene`, imported when they are needed."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from uuvsim_cosim.errors import InputInvalid

__all__ = ["import_extra"]


def import_extra(library: str, what: str) -> ModuleType:
    """Import a library of the extra `scene`, which `what` needs.

    Raises InputInvalid with the command that installs it.
    """
    try:
        return import_module(library)
    except ImportError as reason:
        top = library.partition(".")[0]
        why = "is not installed" if getattr(reason, "name", "") == top else f"fails: {reason}"
        raise InputInvalid(
            f"{what} needs {top}, which {why}; `pip install 'uuvsim-cosim[scene]'` installs it"
        ) from None
