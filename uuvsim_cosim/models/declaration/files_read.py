"""Results that are made from files, shared within the process until one of the files changes."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextvars import ContextVar
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

__all__ = ["noted", "shared_until_changed"]

Stamp = tuple[int, int, int] | None  # modified [ns], size, inode; None: there is no such file
P = ParamSpec("P")
R = TypeVar("R")
_MOST = 256  # results of a function that are kept
_reading: ContextVar[dict[Path, Stamp] | None] = ContextVar("files that are read", default=None)


def noted(path: Path) -> Path:
    """Return the path of a file that is read next: a result in the making depends on it.

    It depends on the file's folder too, for a file may appear there that was not found before.
    """
    files = _reading.get()
    if files is not None:
        for place in (path.absolute(), path.absolute().parent):
            files.setdefault(place, _stamp(place))
    return path


def shared_until_changed(function: Callable[P, R]) -> Callable[P, R]:
    """Call a function once for the same arguments, until a file that it has read changes.

    Every file that it reads must be given to `noted` first. Arguments may name files by relative
    paths, so a result holds in one working folder. An error is not kept.
    """
    kept: dict[object, tuple[R, dict[Path, Stamp]]] = {}

    @wraps(function)
    def shared(*args: P.args, **kwargs: P.kwargs) -> R:
        key = (os.getcwd(), args, tuple(kwargs.items()))
        found = kept.get(key)
        if found is None or any(_stamp(path) != was for path, was in found[1].items()):
            files: dict[Path, Stamp] = {}
            before = _reading.set(files)
            try:
                found = kept[key] = function(*args, **kwargs), files
            finally:
                _reading.reset(before)
            for old in list(kept)[:-_MOST]:
                kept.pop(old, None)
        if (around := _reading.get()) is not None:
            around.update(found[1])
        return found[0]

    return shared


def _stamp(path: Path) -> Stamp:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
