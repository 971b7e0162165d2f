"""Memory for recorded rows, stored column by column and allocated before stepping begins."""

from __future__ import annotations

import contextlib
import mmap

import numpy as np

__all__ = ["columns_of"]

_LINE = 8  # slots of 8 bytes in a cache line
_PAGE = 512  # slots in a page
_HUGE = 1 << 21  # bytes


def columns_of(columns: int, rows: int) -> np.ndarray:
    """Return zeros (columns, at least `rows`) of uint64; numbers of a column are contiguous.

    The distance of two columns is an odd number of cache lines, so that the values of a row do not
    all fall into one set of the cache. Every page is written here: a page fault while stepping
    costs as much as many steps.
    """
    lines = -(-rows // _LINE) | 1
    stride = lines * _LINE
    n = columns * stride
    if 8 * n < _HUGE // 2 or not hasattr(mmap, "MADV_HUGEPAGE"):
        return np.full(n, 0, np.uint64).reshape(columns, stride)
    memory = mmap.mmap(-1, -(-8 * n // _HUGE) * _HUGE)
    with contextlib.suppress(OSError):  # the kernel has no huge pages
        memory.madvise(mmap.MADV_HUGEPAGE)
    slots = np.frombuffer(memory, np.uint64, n)
    slots[::_PAGE] = 0
    return slots.reshape(columns, stride)
