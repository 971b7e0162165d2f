"""Memory of environments in blocks of lanes (structure of arrays), and the variables in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import final

import numpy as np
from numpy.typing import DTypeLike

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.kernels.codegen.program import Program
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Column", "Lanes", "Signal", "aligned", "signal_of"]

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
        size = prod(shape)
        self._cells = cells[:, first : first + size, :]
        every = self._cells.transpose(0, 2, 1)
        self._every = every.reshape(lanes.n_blocks, lanes.width, *shape)
        self._own = self._every[0, : lanes.n_envs] if lanes.n_blocks == 1 else None
        self._rows = (lanes.n_blocks * lanes.width, *shape)
        self._lanes, self._dtype, self._shape = lanes, dtype, shape

    def view(self) -> np.ndarray:
        """Return the cells: (blocks, elements, lanes)."""
        return self._cells

    def read(self) -> np.ndarray:
        """Copy the values, one row for each environment."""
        if self._own is not None:
            return self._own.astype(self._dtype)
        return self._every.astype(self._dtype).reshape(self._rows)[: self._lanes.n_envs]

    def is_equal(self) -> bool:
        """Return whether all lanes have the same bits."""
        bits = self._every.view(np.int64 if self._every.itemsize == 8 else np.int32)
        return bool((bits == bits[0, 0]).all())

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


@dataclass(frozen=True, eq=False)
class Signal:
    """Variable, with its present values and its start values in all environments."""

    name: str
    variable: Variable
    member: int
    n_envs: int
    own: Column
    start: Column
    connected: bool
    largest: float  # largest finite number of the kernel's type

    @property
    def is_parameter(self) -> bool:
        """Return whether derived values depend on it."""
        return self.variable.causality == "parameter"

    def checked(self, values: object) -> np.ndarray:
        """Return values that may be set now; raises InputInvalid."""
        v = self.variable
        if v.causality != "input" and not (self.is_parameter and v.variability == "tunable"):
            raise self._wrong("an input or a tunable parameter (others: start= of reset)")
        if self.connected:
            raise InputInvalid(self.name, "is connected", "an unconnected input")
        return self._checked(values)

    def checked_start(self, values: object) -> np.ndarray:
        """Return values that may be start values; raises InputInvalid."""
        if self.variable.causality not in ("input", "parameter"):
            raise self._wrong("an input or a parameter")
        return self._checked(values)

    def _checked(self, values: object) -> np.ndarray:
        """Return values as an array of the right shape and range; raises InputInvalid."""
        v = self.variable
        try:
            array: np.ndarray = np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            raise InputInvalid(self.name, f"value {values!r}", "numbers") from None
        if array.shape not in (v.shape, (self.n_envs, *v.shape)):
            raise InputInvalid(
                self.name,
                f"values of shape {array.shape}",
                f"{v.shape} or {(self.n_envs, *v.shape)}, a row for each environment (n_envs)",
            )
        low = -self.largest if v.min is None else v.min
        high = self.largest if v.max is None else v.max
        if not (array.min() >= low and array.max() <= high):  # comparisons with NaN are false
            wrong = array[~((array >= low) & (array <= high))].flat[0]
            raise InputInvalid(self.name, f"value {wrong}", f"finite numbers in [{low}, {high}]")
        return array

    def _wrong(self, expected: str) -> InputInvalid:
        v = self.variable
        return InputInvalid(self.name, f"is a {v.variability} {v.causality}", expected)


def signal_of(
    kernel: Program,
    name: str,
    memory: Lanes,
    start: Lanes,
    place: Callable[[int], tuple[Lanes, int] | None] = lambda cell: None,
) -> Signal:
    """Find a variable by its full name, "hull.eta"; raises InputInvalid with similar names.

    `place` returns where the cell of a variable is, if it is not in `memory`.
    """
    fused = kernel.fused
    path, _, own = name.rpartition(".")
    i = fused.index.get(path)
    variables = {} if i is None else fused.plan.components[i].description.variables
    if i is None or own not in variables:
        known = [f"{c.path}.{n}" for c in fused.plan.components for n in c.description.variables]
        known = [n for n in known if n.startswith(f"{path}.")] or known
        raise InputInvalid(f"no variable {name!r}", expected_names(name, known))
    v, m = variables[own], fused.members[i]
    first = v.value_references[0]
    dtype = {"Float64": kernel.dtype, "Boolean": np.dtype(bool)}.get(v.type, np.dtype(np.int32))
    bits = kernel.dtype != np.float64 and m.is_seed(own)
    connected = fused.plan.connected.get((i, own), ())
    has_start = first < m.n_start
    lanes, cell = place(m.cell + first) or (memory, m.cell + first)
    # A variable without a start may be larger than the start values of all others together.
    begin = (m.start_cell + first, v.shape) if has_start else (0, ())
    return Signal(
        name,
        v,
        i,
        memory.n_envs,
        Column(lanes, cell, v.shape, dtype, bits=bits),
        Column(start, *begin, dtype, bits=bits),
        len(connected) == v.size,
        float(np.finfo(kernel.dtype).max),
    )
