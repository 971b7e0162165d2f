"""Deferred Ctrl-C: an interrupt waits until an operation is complete."""

from __future__ import annotations

import threading

# Without the enumerations of the module `signal`, which take some 20 µs a time.
from _signal import getsignal, signal  # type: ignore[import-not-found]
from collections.abc import Iterator
from contextlib import contextmanager
from signal import SIGINT
from types import FrameType

__all__ = ["uninterrupted"]


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let an interruption come after the block; other threads than the main one get none anyway."""
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
