"""Variables of all environments of a batch as rows of one array, copied in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np

from uuvsim_cosim.kernels.codegen.program import Program

__all__ = ["Exchange"]


@final
class Exchange:
    """Cells of `n` environments as rows (size, n) of float64.

    `views` are the cells in memory, (blocks, elements, lanes) each, of `Batch.view`.
    """

    def __init__(self, kernel: Program, n: int, views: Sequence[np.ndarray]) -> None:
        self._c, self._n, self._views = kernel.c, n, list(views)
        first = [_address(v) + i * v.strides[1] for v in views for i in range(v.shape[1])]
        stride = [v.strides[0] for v in views for _ in range(v.shape[1])]
        self._table = np.array([first, stride], np.int64).reshape(2, len(first))
        self._size = len(first)
        self._addresses = _address(self._table), _address(self._table) + self._table.strides[0]
        # Cells of other types than the kernel's hold integers.
        self._integers: list[tuple[int, np.ndarray]] = []
        at = 0
        for view in views:
            if view.dtype != kernel.dtype:
                self._integers.append((at, view))
            at += view.shape[1]

    def read(self) -> np.ndarray:
        """Copy the values of all environments."""
        rows = np.empty((self._size, self._n))
        self._c.uuv_kernel_gather(*self._addresses, self._size, _address(rows), self._n)
        for at, view in self._integers:
            whole = view.swapaxes(0, 1).reshape(view.shape[1], -1)
            rows[at : at + view.shape[1]] = whole[:, : self._n]
        return rows

    def write(self, rows: np.ndarray) -> None:
        """Set the values of all environments, which no cell of integers has."""
        given = np.ascontiguousarray(rows, np.float64)
        self._c.uuv_kernel_scatter(*self._addresses, self._size, _address(given), self._n)


def _address(array: np.ndarray) -> int:
    address: int = array.__array_interface__["data"][0]
    return address
