"""Memory that a plant and its worker processes share: actions, signals, seeds, masks."""

from __future__ import annotations

import contextlib
import mmap
import os
import tempfile
from pathlib import Path
from typing import final

import numpy as np

__all__ = ["Shared"]


@final
class Shared:
    """Arrays over one mapped file, which has no name any more once all have opened it."""

    def __init__(self, path: str | None, n_read: int, n_acted: int, n: int) -> None:
        parts = (n_read * n, n_acted * n, n, n, n)
        size = 8 * sum(parts)
        if path is None:
            fast = Path("/dev/shm")  # memory, where there is such a folder
            folder = fast if fast.is_dir() and os.access(fast, os.W_OK) else None
            handle, self.path = tempfile.mkstemp(prefix="uuvsim-", dir=folder)
            os.truncate(handle, size)
        else:
            handle, self.path = os.open(path, os.O_RDWR), path
        try:
            self._map = mmap.mmap(handle, size)
        finally:
            os.close(handle)
        ends = np.cumsum((0, *parts)) * 8
        doubles = [np.frombuffer(self._map, np.float64, c, int(e))
                   for c, e in zip(parts, ends, strict=False)]  # fmt: skip
        self.signals = doubles[0].reshape(n_read, n)
        self.actions = doubles[1].reshape(n_acted, n)
        self.seeds = doubles[2].view(np.uint64)
        self.mask = doubles[3].view(np.uint8)[:n].view(bool)
        self.failed = doubles[4].view(np.uint8)[:n].view(bool)

    def unlink(self) -> None:
        """Take the file's name away; a second call does nothing."""
        with contextlib.suppress(OSError):
            os.unlink(self.path)
