"""Place of an unexpected error in the user's own code: a task, a component."""

from __future__ import annotations

import sysconfig
import traceback
from pathlib import Path

import uuvsim_cosim

__all__ = ["place_in_other_code"]

OURS = str(Path(uuvsim_cosim.__file__).parent)
STANDARD = tuple(sysconfig.get_path(name) for name in ("stdlib", "platstdlib"))
INSTALLED = {"site-packages", "dist-packages"}


def place_in_other_code(error: BaseException) -> str | None:
    """Return "FILE:LINE" where the innermost code that is no library's is not ours; else None."""
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if frame.filename.startswith(OURS):
            return None
        library = frame.filename.startswith(("<", *STANDARD))
        if library or INSTALLED & set(Path(frame.filename).parts):
            continue
        return f"{frame.filename}:{frame.lineno}"
    return None
