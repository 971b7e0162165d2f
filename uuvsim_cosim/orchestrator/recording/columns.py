"""Columns of a recording that are read from its file when they are asked for, or in blocks."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from threading import Lock
from typing import Any, Protocol

import numpy as np

__all__ = ["BLOCK", "LazyArrays", "Source", "Table", "as_array", "column"]

KEPT = 32 << 20  # bytes of arrays that are kept for the next use
BLOCK = 4096  # rows of a block, at most
WIDE = 128  # columns of a signal that are read at once

_NUMBERS = {"double": np.float64, "int64": np.int64, "uint64": np.uint64}


class Table(Protocol):
    """File of a recording: columns by their number, or all columns of some rows."""

    @property
    def rows(self) -> int:
        """Return the number of rows."""

    def parts(self, numbers: Sequence[int]) -> Iterator[Any]:
        """Yield Arrow's RecordBatch of the next rows of some columns, in the order of `numbers`."""

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
            values = self._whole(source)
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

        parts = self._table.parts([self._sources[name].numbers[k]])
        while True:
            with self._reading:
                part = next(parts, None)
            if part is None:
                return
            yield self._change(as_array(pa.chunked_array([part.column(0)]), copied=False))

    def at_rows(self, name: str, rows: np.ndarray) -> np.ndarray:
        """Return a signal at some rows, from 0, in ascending order.

        Memory holds these and one block of other rows: an image of thousands of elements that
        changes in few rows is best read with this.
        """
        with self._reading:
            return self._whole(self._sources[name], rows)

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

    def _whole(self, source: Source, rows: np.ndarray | None = None) -> np.ndarray:
        starts = range(0, len(source.numbers), WIDE)
        parts = (source.numbers[k : k + WIDE] for k in starts)
        each = (array for part in parts for array in _columns(self._table, part, rows))
        return self._array(source, each)

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
    return _columns(table, [number])[0]


def _columns(
    table: Table, numbers: Sequence[int], rows: np.ndarray | None = None
) -> list[np.ndarray]:
    """Return columns as arrays of their own, at all rows or at some in ascending order."""
    import pyarrow as pa

    count = table.rows if rows is None else len(rows)
    whole: list[np.ndarray] = [np.empty(0) for _ in numbers]
    first = place = 0
    for part in table.parts(numbers):
        picked: Any = slice(None)
        end = place + part.num_rows
        if rows is not None:
            low, end = np.searchsorted(rows, [first, first + part.num_rows]).tolist()
            picked = rows[low:end] - first
        for k in range(len(numbers)):
            values = as_array(pa.chunked_array([part.column(k)]), copied=False)[picked]
            # Integers without a value are read as NaN.
            type_ = np.promote_types(whole[k].dtype, values.dtype) if first else values.dtype
            if first == 0:
                whole[k] = np.empty(count, type_)
            elif type_ != whole[k].dtype:
                whole[k] = whole[k].astype(type_)
            whole[k][place:end] = values
        first, place = first + part.num_rows, end
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
