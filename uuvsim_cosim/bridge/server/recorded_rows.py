"""Room for the recorded rows of one run: in memory, or where it is large in a temporary file."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Mapping
from typing import Any, final

import numpy as np

from uuvsim_cosim.errors import InputInvalid, RecordingError

__all__ = ["Store"]


@final
class Store:
    """Arrays of `rows` rows by name, each with a type and the shape of a row.

    A file has no name, and goes with the last array that lies in it.
    """

    def __init__(
        self,
        rows: int,
        kinds: Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]],
        *,
        in_file: bool,
    ) -> None:
        self._kinds = kinds
        self._places: dict[str, int] = {}  # in the file [bytes]
        self._arrays: dict[str, np.ndarray] = {}
        self._file: Any = None
        size = 0
        for name, (dtype, shape) in kinds.items():
            if in_file and not dtype.hasobject:
                self._places[name] = size
                size += rows * dtype.itemsize * int(np.prod(shape, dtype=int))
            else:
                self._arrays[name] = _room(rows, dtype, shape)
        if size:
            free = shutil.disk_usage(tempfile.gettempdir()).free
            if size > free // 2:
                raise InputInvalid(
                    f"run: its recording takes {size} bytes of a temporary file, and {free} are "
                    f"free in {tempfile.gettempdir()}; expected twice as many: record fewer "
                    "signals, or run in pieces"
                )
            self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
            weakref.finalize(self, self._file.close)  # arrays that are mapped live on

    def put(self, row: int, values: Mapping[str, np.ndarray]) -> None:
        """Keep values from a row on, each of shape (n, …); raises RecordingError if it cannot."""
        for name, given in values.items():
            dtype, shape = self._kinds[name]
            rows = given.astype(dtype, copy=False).reshape(len(given), *shape)
            if name in self._arrays:
                self._arrays[name][row : row + len(rows)] = rows
                continue
            size = dtype.itemsize * int(np.prod(shape, dtype=int))
            try:
                self._file.seek(self._places[name] + row * size)
                data = memoryview(np.ascontiguousarray(rows).tobytes())
                while data:
                    data = data[self._file.write(data) :]
            except OSError as error:
                raise RecordingError(
                    f"run: its temporary file cannot be written: {error.strerror}; expected room "
                    f"in {tempfile.gettempdir()}"
                ) from None

    def taken(self, rows: int) -> dict[str, np.ndarray]:
        """Return the first rows of all; those in the file are mapped, to be read in pieces."""
        given: dict[str, np.ndarray] = {}
        for name, (dtype, shape) in self._kinds.items():
            if name in self._arrays:
                given[name] = self._arrays[name][:rows]
            elif 0 in shape:
                given[name] = np.zeros((rows, *shape), dtype)
            else:
                at = self._places[name]
                given[name] = np.memmap(self._file, dtype, "r", at, (rows, *shape))
        return given


def _room(rows: int, dtype: np.dtype[Any], shape: tuple[int, ...]) -> np.ndarray:
    try:
        return np.empty((rows, *shape), dtype)
    except (MemoryError, ValueError):  # ValueError: more than an array may have
        raise InputInvalid(
            f"run: there is no memory for {rows} rows; expected a shorter run, in pieces"
        ) from None
