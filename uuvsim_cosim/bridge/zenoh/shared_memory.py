"""Shared memory for large payloads to clients on this machine, if it is available.

Zenoh gives a client on the same machine the address instead of the bytes, and any other client the
bytes. If shared memory is full or missing, payloads are sent as bytes; clients see no difference.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, final

import numpy as np

if TYPE_CHECKING:
    from zenoh import shm

__all__ = ["LARGE", "SharedMemory"]

LARGE = 100_000  # bytes above which shared memory is faster (benchmarks/bridge/bridge_frames.py)
POOL = 64 << 20  # bytes; the kernel allocates only those that are used
SMALL = 4 << 20  # bytes; a smaller pool is not used


@final
class SharedMemory:
    """Memory for the payloads of one publisher thread, allocated with the first large payload."""

    def __init__(self, *, wanted: bool = True) -> None:
        self._wanted = wanted
        self._pool: tuple[shm.ShmProvider, shm.GarbageCollect] | None = None
        self.used = 0  # payloads that were in shared memory

    def payload(self, header: bytes, values: np.ndarray) -> bytes | shm.ZShmMut:
        """Return header and values as one payload, in shared memory if they are large."""
        size = len(header) + values.nbytes
        if size < LARGE or not self._wanted:
            return header + values.tobytes()
        try:
            if self._pool is None:
                self._wanted = False  # if this fails, it is not tried again
                from zenoh import shm

                provider = shm.ShmProvider.default_backend(_pool_size())
                self._pool, self._wanted = (provider, shm.GarbageCollect()), True
            memory = self._pool[0].alloc(size, self._pool[1])
        except Exception:  # full at the moment, or not available
            return header + values.tobytes()
        memory[0 : len(header)] = header
        memory[len(header) : size] = values.tobytes()
        self.used += 1
        return memory


def _pool_size() -> int:
    """Return the size of the pool: at most a quarter of Linux's free shared memory.

    Containers often have 64 MB. A process that writes beyond them is killed (SIGBUS).
    """
    try:
        file_system = os.statvfs("/dev/shm")
    except (AttributeError, OSError):  # not Linux
        return POOL
    free = file_system.f_bavail * file_system.f_frsize // 4
    if free < SMALL:
        raise MemoryError(f"{free} bytes of shared memory; expected {SMALL}")
    return min(POOL, free)
