"""Memory that a plant and its worker processes share: actions, signals, seeds, masks."""

from __future__ import annotations

import contextlib
import mmap
import os
import shutil
import tempfile
from pathlib import Path
from typing import final

import numpy as np

from uuvsim_cosim.errors import InputInvalid

__all__ = ["Shared"]

BY_HANDLE = os.name == "posix"  # children inherit the handle, and the file needs no name


@final
class Shared:
    """Arrays over one mapped file, without a name where children inherit handles.

    So no file remains when a process is killed. `source` is the `key` of another process.
    """

    def __init__(self, source: int | str | None, n_read: int, n_acted: int, n: int) -> None:
        parts = (n_read * n, n_acted * n, n, n, n)
        size = 8 * sum(parts)
        self.key: int | str
        self._is_owner = source is None
        if source is None:
            self._handle, path = _new(size)
            self.key = self._handle if BY_HANDLE else path
        else:
            self._handle = source if isinstance(source, int) else os.open(source, os.O_RDWR)
            self.key = source
        try:
            self._map = mmap.mmap(self._handle, size)
        except BaseException:
            self.release()
            raise
        ends = np.cumsum((0, *parts)) * 8
        doubles = [np.frombuffer(self._map, np.float64, c, int(e))
                   for c, e in zip(parts, ends, strict=False)]  # fmt: skip
        self.signals = doubles[0].reshape(n_read, n)
        self.actions = doubles[1].reshape(n_acted, n)
        self.seeds = doubles[2].view(np.uint64)
        self.mask = doubles[3].view(np.uint8)[:n].view(bool)
        self.failed = doubles[4].view(np.uint8)[:n].view(bool)

    @property
    def handles(self) -> tuple[int, ...]:
        """The handles that a child must inherit, until `release`."""
        return (self._handle,) if BY_HANDLE else ()

    def release(self) -> None:
        """Close the handle, and delete the file's name if there is one: no process can join."""
        handle, self._handle = self._handle, -1
        if handle >= 0:
            os.close(handle)
        if isinstance(self.key, str) and self._is_owner:
            with contextlib.suppress(OSError):
                os.unlink(self.key)


def _new(size: int) -> tuple[int, str]:
    """Make a file of zeros, in memory where there is such a folder with room for it."""
    fast = Path("/dev/shm")
    folders = [fast] if fast.is_dir() and os.access(fast, os.W_OK) else []
    folders.append(Path(tempfile.gettempdir()))
    available = {folder: shutil.disk_usage(folder).free for folder in folders}
    folder = next((f for f in folders if available[f] > size), None)
    if folder is None:
        free = ", ".join(f"{n_bytes / 1e9:.3g} GB in {f}" for f, n_bytes in available.items())
        raise InputInvalid(
            f"{size / 1e9:.3g} GB of memory to share with processes, where there are {free}",
            "fewer environments, or more room",
        )
    handle, path = tempfile.mkstemp(prefix=f"uuvsim-{os.getpid()}-", dir=folder)
    try:
        if BY_HANDLE:
            os.unlink(path)
        os.truncate(handle, size)
    except BaseException:
        os.close(handle)
        raise
    return handle, path
