"""Columns of a recording that are read from its file when they are asked for, or in blocks."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from threading import Lock
from typing import Any, Protocol

import numpy as np

__all__ = ["BLOCK", "LazyArrays", "Source", "Table", "as_array", "column"]

KEPT = 32 << 20  # bytes of arrays that are kept for the next use
BLOCK = 4096  # rows of a block, at most

_NUMBERS = {"double": np.float64, "int64": np.int64, "uint64": np.uint64}


class Table(Protocol):
    """File of a recording: columns by their number, or all columns of some rows."""

    @property
    def rows(self) -> int:
        """Return the number of rows."""

    def chunks(self, number: int) -> Iterator[Any]:
        """Yield Arrow's Array of the next rows of a column."""

    def batches(self, most: int) -> Iterator[Any]:
        """Yield Arrow's RecordBatch of the next rows, at most `most` of them."""


@dataclass(frozen=True)
class Source:
    """Columns of one signal: of its elements in order, or the one of a scalar."""

    numbers: tuple[int, ...]
    is_array: bool
    is_number: bool


class LazyArrays(Mapping[str, np.ndarray]):
    """Signals by name, read at each use: memory holds those that were used last.

    An array has the shape (n,) for a scalar and (n, size) for an array, as in `Signals`. `change`
    is applied to what was read.
    """

    def __init__(
        self,
        table: Table,
        sources: Mapping[str, Source],
        change: Callable[[np.ndarray], np.ndarray] = lambda values: values,
    ) -> None:
        """Note where each signal is; nothing is read."""
        self._table, self._sources, self._change = table, sources, change
        self._kept: OrderedDict[str, np.ndarray] = OrderedDict()
        self._reading = Lock()

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a signal."""
        source = self._sources[name]
        with self._reading:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
            values = self._array(source, (column(self._table, n) for n in source.numbers))
            # It is shared by all who ask for it, until it is read again.
            values.flags.writeable = False
            self._kept[name] = values
            held = sum(v.nbytes for v in self._kept.values())
            while held > KEPT and len(self._kept) > 1:
                held -= self._kept.popitem(last=False)[1].nbytes
            return values

    def __contains__(self, name: object) -> bool:
        """Return whether there is such a signal, without reading it."""
        return name in self._sources

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(self._sources)

    def __len__(self) -> int:
        """Count the signals."""
        return len(self._sources)

    def __reduce__(self) -> tuple[type[dict[str, np.ndarray]], tuple[dict[str, np.ndarray]]]:
        """Become a dictionary of arrays in another process, which may not have the file."""
        return dict, (dict(self),)

    def element_blocks(self, name: str, k: int) -> Iterator[np.ndarray]:
        """Yield element `k`, from 0, of a signal in blocks of rows; only that column is read."""
        import pyarrow as pa

        chunks = self._table.chunks(self._sources[name].numbers[k])
        while True:
            with self._reading:
                chunk = next(chunks, None)
            if chunk is None:
                return
            yield self._change(as_array(pa.chunked_array([chunk]), copied=False))

    def is_array(self, name: str) -> bool:
        """Return whether a signal is an array, without reading it."""
        return self._sources[name].is_array

    def size(self, name: str) -> int:
        """Return the number of elements of a signal, without reading it."""
        return len(self._sources[name].numbers)

    def numbers(self) -> LazyArrays:
        """Return the signals of numbers and Booleans, as float64."""
        sources = {name: s for name, s in self._sources.items() if s.is_number}
        return LazyArrays(self._table, sources, lambda values: np.asarray(values, float))

    def blocks(self) -> Iterator[dict[str, np.ndarray]]:
        """Yield the arrays of the next rows, at most `BLOCK` of them; none is kept."""
        import pyarrow as pa

        for batch in self._table.batches(BLOCK):
            columns = [pa.chunked_array([column]) for column in batch.columns]
            yield {
                name: self._array(
                    source, (as_array(columns[i], not source.is_array) for i in source.numbers)
                )
                for name, source in self._sources.items()
            }

    def _array(self, source: Source, arrays: Iterator[np.ndarray]) -> np.ndarray:
        first = next(arrays)
        if not source.is_array:
            return self._change(first)
        values = np.empty((len(first), len(source.numbers)), first.dtype)
        values[:, 0] = first
        for k, array in enumerate(arrays, start=1):
            values = values.astype(np.promote_types(values.dtype, array.dtype), copy=False)
            values[:, k] = array
        return self._change(values)


def column(table: Table, number: int) -> np.ndarray:
    """Return a column as an array of its own; memory holds it and one block of rows."""
    import pyarrow as pa

    whole, row = np.empty(0), 0
    for chunk in table.chunks(number):
        values = as_array(pa.chunked_array([chunk]), copied=False)
        # Integers without a value are read as NaN.
        type_ = np.promote_types(whole.dtype, values.dtype) if row else values.dtype
        if row == 0:
            whole = np.empty(table.rows, type_)
        elif type_ != whole.dtype:
            whole = whole.astype(type_)
        whole[row : row + len(values)] = values
        row += len(values)
    return whole


def as_array(column: Any, copied: bool = True) -> np.ndarray:
    """Return a column (Arrow's ChunkedArray) as an array of its own, or one that may not be
    changed if it need not be `copied`.

    Numbers and Booleans are read from Arrow's buffers, since `to_numpy` imports pandas (0.8 s)
    where that is installed.
    """
    type_ = str(column.type)
    if column.null_count or type_ not in (*_NUMBERS, "bool"):
        array: np.ndarray = column.to_numpy()
        return array
    parts = [np.empty(0, _NUMBERS.get(type_, np.bool_))]
    for chunk in column.chunks:
        data, end = chunk.buffers()[1], chunk.offset + len(chunk)
        if type_ == "bool":
            bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
            parts.append(bits[chunk.offset : end].astype(bool))
        else:
            parts.append(np.frombuffer(data, _NUMBERS[type_])[chunk.offset : end])
    return np.concatenate(parts) if copied or len(parts) != 2 else parts[1]
