"""Cells of many environments that pass through memory in a step, in arrays of their own."""

from __future__ import annotations

import ctypes
from collections.abc import Collection, Iterable
from typing import final

import numpy as np

from uuvsim_cosim.kernels.batch.memory import Lanes
from uuvsim_cosim.kernels.codegen.fusible import Fused

__all__ = ["Parts", "cells_of_parts"]


class _Part(ctypes.Structure):
    """`uuv_lane_part` of fmus/kernels/uuv_lane_parts.h."""

    _fields_ = (
        ("cells", ctypes.c_void_p),
        ("ranges", ctypes.c_void_p),
        ("n_ranges", ctypes.c_uint64),
        ("n_cells", ctypes.c_uint64),
    )


@final
class Parts:
    """The arrays of one batch: cells that a step carries, is given, and keeps for a reader.

    A step reads the cells `carried` and `given`, and writes `carried` and `kept`. Parameters and
    all other cells stay in the whole blocks of the batch. With `reads`, only those outputs and
    inputs are kept that it names, "hull.eta".
    """

    def __init__(self, fused: Fused, memory: Lanes, reads: Collection[str] | None) -> None:
        self._arrays: list[Lanes] = []
        self._place: dict[int, tuple[Lanes, int]] = {}
        self._ranges: list[np.ndarray] = []
        structures = []
        starts = {m.cell + v.offset for m in fused.members for v in m.layout.values}
        for cells in cells_of_parts(fused, reads):
            n_words = 0 if self._arrays else fused.n_words  # the first cells, which are carried
            array = Lanes(memory.n_envs, len(cells), memory.width, memory.cells.dtype, n_words)
            self._place |= {cell: (array, i) for i, cell in enumerate(cells)}
            ranges = _ranges(cells, starts)
            self._arrays.append(array)
            self._ranges.append(ranges)
            structures.append(
                _Part(array.address, ranges.ctypes.data, len(ranges), array.cells.shape[1])
            )
        self._c = (_Part * 3)(*structures)
        self.address = ctypes.addressof(self._c)
        self.words = self._arrays[0]

    def place(self, cell: int) -> tuple[Lanes, int] | None:
        """Return where a cell is, if it is in one of the arrays; a variable is always in one."""
        return self._place.get(cell)


def cells_of_parts(
    fused: Fused, reads: Collection[str] | None = None
) -> tuple[list[int], list[int], list[int]]:
    """Return the cells that a step carries, is given, and keeps, each in order.

    Carried are the ticks, states, and outputs that the next step reads; given are seeds and
    inputs without connections. Whole variables are in one of the three.
    """
    members = fused.members
    late: set[tuple[int, str]] = set()  # outputs that the next step reads
    connected: dict[tuple[int, str], int] = {}  # inputs, and how many of their elements
    for t in fused.plan.transfers:
        into = (t.target, t.target_variable.name)
        connected[into] = connected.get(into, 0) + len(t.target_elements)
        if not fused.is_early(t):
            late.add((t.source, t.source_variable.name))
    carried = list(range(fused.n_words * fused.cells_a_word))
    given: list[int] = []
    kept: list[int] = []
    for i, m in enumerate(members):
        slower = m.rate >= 0
        if slower:
            carried.append(m.cell)  # the time
        elif reads is None:
            kept.append(m.cell)
        for v in m.layout.values:
            n_connected = connected.get((i, v.name), 0)
            cells = range(m.cell + v.offset, m.cell + v.offset + v.size)
            is_carried = slower or (i, v.name) in late or 0 < n_connected < v.size
            if v.kind in ("state", "discrete") or (v.kind in ("input", "output") and is_carried):
                carried += cells
            elif m.is_seed(v.name) or (v.kind == "input" and not n_connected):
                given += cells
            elif v.kind in ("input", "output") and (reads is None or f"{m.path}.{v.name}" in reads):
                kept += cells
        carried += range(m.cell + m.layout.size, m.cell + m.size)  # pending outputs
    return sorted(carried), sorted(given), sorted(kept)


def _ranges(cells: Iterable[int], first: Collection[int] = ()) -> np.ndarray:
    """Return ascending cells as pairs of the first one and the one after the last one.

    A new range begins at each of the cells `first`.
    """
    numbers = np.fromiter(cells, np.int64)
    ends = np.flatnonzero((np.diff(numbers) != 1) | np.isin(numbers[1:], list(first)))
    first = numbers[np.concatenate([[0], ends + 1])] if len(numbers) else numbers
    last = numbers[np.concatenate([ends, [-1]])] if len(numbers) else numbers
    return np.ascontiguousarray(np.stack([first, last + 1], axis=1).astype(np.uint32))
