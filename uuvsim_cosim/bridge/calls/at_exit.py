"""Closing of objects that are still open when Python ends, before Python joins its threads.

`atexit` comes too late: Python first joins every thread. A thread that waits for a message which
nobody will send would keep Python from ever ending.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import threading
import weakref
from typing import Protocol

__all__ = ["close_at_exit"]


class _Closing(Protocol):
    def close(self) -> None:
        """Close; a second call does nothing."""


_open: weakref.WeakValueDictionary[int, _Closing] = weakref.WeakValueDictionary()
_numbers = itertools.count()


def close_at_exit(closing: _Closing) -> None:
    """Close an object at the end of the program, if it lives then and is open still.

    An object that was registered later is closed earlier, because it may use those before it.
    """
    _open[next(_numbers)] = closing


def _close_all() -> None:
    for _, closing in sorted(_open.items(), reverse=True):
        with contextlib.suppress(Exception):  # nobody could handle the error any more
            closing.close()


# Runs before threads are joined. There is no public name for it; `concurrent.futures` uses it too.
threading._register_atexit(_close_all)  # type: ignore[attr-defined]
if hasattr(os, "register_at_fork"):  # a forked child does not own its parent's connections
    os.register_at_fork(after_in_child=_open.clear)
