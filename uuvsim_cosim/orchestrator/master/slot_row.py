"""Layout of a row of slots: values of several variables, exchanged as one piece of memory."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from typing import final

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.master.core_library import Type, by_type

__all__ = ["SlotRow"]


@final
class SlotRow:
    """Numbers of `variables` in consecutive slots, in the order in which the loop places them.

    `places` has the elements of each variable in the flat sequence of numbers, `start` their start
    values. A row contains no text and no binary values.

    Example:

    >>> from uuvsim_cosim.fmus.description import Variable
    >>> from uuvsim_cosim.orchestrator.master.slot_row import SlotRow
    >>> row = SlotRow([Variable("on", "Boolean", "input", "discrete", (), None, False),
    ...                Variable("x", "Float64", "input", "continuous", (2,), "m", [0.0, 0.0])])
    >>> row.places["on"], row.unpack(row.pack([0.5, 1.5, True]))
    (slice(2, 3, None), (0.5, 1.5, 1))
    """

    def __init__(self, variables: Iterable[Variable]) -> None:
        self.places: dict[str, slice] = {}
        codes, first, start = "", 0, []
        for v in by_type(variables):
            if Type.of(v).is_blob:
                raise InputInvalid(f"row of slots: {v.name}", f"is {v.type}", "a number")
            self.places[v.name] = slice(first, first + v.size)
            first += v.size
            start += np.ravel(v.start).tolist()
            codes += {"f8": "d", "i8": "q", "u8": "Q"}[Type.of(v).dtype] * v.size
        self._struct = struct.Struct(f"={codes}")
        self.start = tuple(start)

    def pack(self, numbers: Sequence[float]) -> bytes:
        """Return the bytes of a row."""
        return self._struct.pack(*numbers)

    def unpack(self, row: bytes) -> tuple[float, ...]:
        """Return the numbers of a row."""
        return self._struct.unpack(row)
