"""Values of environments in blocks of lanes: structure of arrays, aligned for vector registers."""

from __future__ import annotations

from typing import final

import numpy as np

__all__ = ["Lanes", "aligned"]

_ALIGNMENT = 128  # bytes: of the widest V


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Give zeros whose first byte is aligned for every V."""
    n = int(np.prod(shape, dtype=int))
    room = np.zeros(n + _ALIGNMENT // 8)
    first = (-room.ctypes.data % _ALIGNMENT) // 8
    return room[first : first + n].reshape(shape)


@final
class Lanes:
    """Cells of W lanes, block by block: environment e is lane e mod W of block e div W."""

    def __init__(self, n_envs: int, n_cells: int, width: int) -> None:
        self.n_envs = n_envs
        self.width = width
        self.n_blocks = -(-n_envs // width)
        self.cells = aligned((self.n_blocks, n_cells, width))
        self.bits = self.cells.view(np.uint64)

    @property
    def address(self) -> int:
        """Give the address of the first cell."""
        return int(self.cells.ctypes.data)

    def read(self, first: int, size: int, *, bits: bool = False) -> np.ndarray:
        """Copy `size` cells from `first` on, one row an environment."""
        cells = (self.bits if bits else self.cells)[:, first : first + size, :]
        return cells.transpose(0, 2, 1).reshape(-1, size)[: self.n_envs].copy()

    def write(self, first: int, rows: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Set cells from one row an environment, where the mask is true.

        Lanes without an environment get what the last environment gets.
        """
        wide = self.padded(rows).reshape(self.n_blocks, self.width, -1).transpose(0, 2, 1)
        cells = self.cells[:, first : first + rows.shape[1], :]
        if mask is None:
            cells[...] = wide
            return
        chosen = self.padded(mask).reshape(self.n_blocks, 1, self.width)
        np.copyto(cells, wide, where=chosen)

    def padded(self, rows: np.ndarray) -> np.ndarray:
        """Repeat the last row for the lanes that have no environment."""
        more = self.n_blocks * self.width - self.n_envs
        return np.concatenate([rows, np.repeat(rows[-1:], more, axis=0)]) if more else rows
