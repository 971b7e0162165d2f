"""Memory for recorded rows, column by column, allocated before stepping begins."""

from __future__ import annotations

import contextlib
import mmap

import numpy as np

__all__ = ["columns_of"]

_LINE = 8  # slots of 8 bytes in a line of the cache
_PAGE = 512  # in a page
_HUGE = 1 << 21  # bytes


def columns_of(columns: int, rows: int) -> np.ndarray:
    """Return zeros (columns, at least `rows`) of uint64; numbers of a column lie side by side.

    The distance of two columns is an odd number of cache lines, so that a row does not fall into
    one set of the cache. Memory is touched here: a page fault costs as much as many steps.
    """
    lines = -(-rows // _LINE) | 1
    stride = lines * _LINE
    return _touched(columns * stride).reshape(columns, stride)


def _touched(n: int) -> np.ndarray:
    size = 8 * n
    if size < _HUGE // 2 or not hasattr(mmap, "MADV_HUGEPAGE"):
        return np.full(n, 0, np.uint64)
    memory = mmap.mmap(-1, -(-size // _HUGE) * _HUGE)
    with contextlib.suppress(OSError):  # a kernel without
        memory.madvise(mmap.MADV_HUGEPAGE)
    room = np.frombuffer(memory, np.uint64, n)
    room[::_PAGE] = 0
    return room
