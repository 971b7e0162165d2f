"""Deferred Ctrl-C: an interrupt waits until an operation is complete."""

from __future__ import annotations

import threading

# The functions of the module `signal` convert to enumerations, which takes some 20 µs a call.
from _signal import getsignal, signal  # type: ignore[import-not-found]
from collections.abc import Iterator
from contextlib import contextmanager
from signal import SIGINT
from types import FrameType

__all__ = ["uninterrupted"]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer Ctrl-C until the end of the block; Python raises it in the main thread only."""
    before = getsignal(SIGINT)
    main = threading.current_thread() is threading.main_thread()
    if not main or not callable(before):
        yield
        return
    caught: list[tuple[int, FrameType | None]] = []
    signal(SIGINT, lambda number, frame: caught.append((number, frame)))
    try:
        yield
    finally:
        signal(SIGINT, before)
        if caught:
            before(*caught[0])
