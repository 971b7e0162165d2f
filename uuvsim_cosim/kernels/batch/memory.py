"""Values of environments in blocks of lanes: structure of arrays, aligned for vector registers."""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import DTypeLike

__all__ = ["Column", "Lanes", "aligned"]

_ALIGNMENT = 128  # bytes: of the widest vector of 64-bit integers


def aligned(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> np.ndarray:
    """Return zeros whose first byte is aligned for every vector."""
    n_bytes = int(np.prod(shape, dtype=int)) * np.dtype(dtype).itemsize
    buffer = np.zeros(n_bytes + _ALIGNMENT, np.uint8)
    first = -buffer.ctypes.data % _ALIGNMENT
    cells: np.ndarray = buffer[first : first + n_bytes].view(dtype).reshape(shape)
    return cells


@final
class Lanes:
    """Cells of W lanes, block by block: environment e is lane e mod W of block e div W.

    The first cells of a block hold `n_words` 64-bit integers for each lane.
    """

    def __init__(
        self, n_envs: int, n_cells: int, width: int, dtype: np.dtype, n_words: int = 0
    ) -> None:
        self.n_envs = n_envs
        self.width = width
        self.n_blocks = -(-n_envs // width)
        self.cells = aligned((self.n_blocks, n_cells, width), dtype)
        self.address = int(self.cells.ctypes.data)
        self._words = np.ndarray(
            (self.n_blocks, n_words, width),
            np.uint64,
            self.cells.data,
            strides=(self.cells.strides[0], 8 * width, 8),
        )

    def word(self, i: int) -> np.ndarray:
        """Return integer number i of each environment; do not write to it."""
        return self._words[:, i, :].reshape(-1)[: self.n_envs]

    def padded(self, rows: np.ndarray) -> np.ndarray:
        """Repeat the last row for the lanes that have no environment."""
        more = self.n_blocks * self.width - self.n_envs
        return np.concatenate([rows, np.repeat(rows[-1:], more, axis=0)]) if more else rows


@final
class Column:
    """One variable of all environments: a view of its cells of the given shape.

    With `bits`, the cells hold 32-bit integers, because a float32 could not hold all of them.
    """

    def __init__(
        self,
        lanes: Lanes,
        first: int,
        shape: tuple[int, ...],
        dtype: np.dtype,
        *,
        bits: bool = False,
    ) -> None:
        cells = lanes.cells.view(np.int32) if bits else lanes.cells
        size = int(np.prod(shape, dtype=int))
        every = cells[:, first : first + size, :].transpose(0, 2, 1)
        self._every = every.reshape(lanes.n_blocks, lanes.width, *shape)
        self._own = self._every[0, : lanes.n_envs] if lanes.n_blocks == 1 else None
        self._rows = (lanes.n_blocks * lanes.width, *shape)
        self._lanes, self._dtype, self._shape = lanes, dtype, shape

    def read(self) -> np.ndarray:
        """Copy the values, one row for each environment."""
        if self._own is not None:
            return self._own.astype(self._dtype)
        return self._every.astype(self._dtype).reshape(self._rows)[: self._lanes.n_envs]

    def write(self, values: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Set the values where masked: one of the variable's shape, or a row for each environment.

        Lanes without an environment get the values of the last environment.
        """
        lanes, each = self._lanes, values.ndim > len(self._shape)
        if each and lanes.n_envs > 1:
            values = lanes.padded(values).reshape(self._every.shape)
        if mask is None:
            self._every[...] = values
            return
        chosen = lanes.padded(mask).reshape(lanes.n_blocks, lanes.width, *(1 for _ in self._shape))
        np.copyto(self._every, values, where=chosen, casting="unsafe")
