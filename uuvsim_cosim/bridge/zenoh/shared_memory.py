"""Large payloads for clients on this machine lie in shared memory, where it can be had.

Zenoh hands a client on the same machine the place instead of the bytes, and a client elsewhere
the bytes. What does not fit, or a machine without shared memory, is sent as bytes: nobody notices.
"""

from __future__ import annotations

import os
from typing import Any, final

import numpy as np

__all__ = ["LARGE", "SharedMemory"]

LARGE = 100_000  # bytes, from which on it pays: measured by benchmarks/bridge_frames.py
POOL = 64 << 20  # bytes; the kernel gives those that are used
SMALL = 4 << 20  # bytes; less is not worth having


@final
class SharedMemory:
    """Memory for the payloads of one publisher thread, asked for when the first is large."""

    def __init__(self, *, wanted: bool = True) -> None:
        self._wanted = wanted
        self._provider: Any = None
        self._policy: Any = None
        self.used = 0  # payloads that lay in it

    def payload(self, header: bytes, values: np.ndarray) -> Any:
        """Return header and values as one payload, in shared memory if they are large."""
        size = len(header) + values.nbytes
        if size < LARGE or not self._wanted:
            return header + values.tobytes()
        try:
            memory = self._ready().alloc(size, self._policy)
        except Exception:  # none left at the moment, or none at all
            return header + values.tobytes()
        memory[0 : len(header)] = header
        memory[len(header) : size] = values.tobytes()
        self.used += 1
        return memory

    def _ready(self) -> Any:
        if self._provider is None:
            try:
                from zenoh import shm

                self._policy = shm.GarbageCollect()
                self._provider = shm.ShmProvider.default_backend(_room())
            except BaseException:
                self._wanted = False
                raise
        return self._provider


def _room() -> int:
    """Return the size of the pool: at most a quarter of what is free where Linux keeps it.

    Containers often have 64 MB; who writes beyond is killed (SIGBUS), not refused.
    """
    try:
        there = os.statvfs("/dev/shm")
    except (AttributeError, OSError):  # not Linux
        return POOL
    free = there.f_bavail * there.f_frsize // 4
    if free < SMALL:
        raise MemoryError(f"{free} bytes of shared memory; expected {SMALL}")
    return min(POOL, free)
