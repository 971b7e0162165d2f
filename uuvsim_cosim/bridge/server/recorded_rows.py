"""Storage of the recorded rows of one run: in memory, or in a temporary file if it is large."""

from __future__ import annotations

import io
import shutil
import tempfile
import weakref
from collections.abc import Mapping
from typing import final

import numpy as np

from uuvsim_cosim.errors import InputInvalid, RecordingError

__all__ = ["Store"]


@final
class Store:
    """Arrays of `rows` rows by name, each with a type and the shape of a row.

    The file has no name; the system deletes it with the last array that is mapped from it.
    """

    def __init__(
        self,
        rows: int,
        formats: Mapping[str, tuple[np.dtype, tuple[int, ...]]],
        *,
        in_file: bool,
    ) -> None:
        self._formats = formats
        self._places: dict[str, int] = {}  # in the file [bytes]
        self._arrays: dict[str, np.ndarray] = {}
        self._file: io.FileIO | None = None
        size = 0
        for name, (dtype, shape) in formats.items():
            if in_file and not dtype.hasobject:
                self._places[name] = size
                size += rows * dtype.itemsize * int(np.prod(shape, dtype=int))
            else:
                self._arrays[name] = _allocated(rows, dtype, shape)
        if size:
            free = shutil.disk_usage(tempfile.gettempdir()).free
            if size > free // 2:
                raise InputInvalid(
                    "run",
                    (
                        f"its recording takes {size} bytes of a temporary file, and {free} "
                        f"are free in {tempfile.gettempdir()}"
                    ),
                    "twice as many: record fewer signals, or run in pieces",
                )
            self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
            weakref.finalize(self, self._file.close)  # mapped arrays stay valid

    def put(self, row: int, values: Mapping[str, np.ndarray]) -> None:
        """Store values from a row on, each of shape (n, …); raises RecordingError if it cannot."""
        for name, given in values.items():
            dtype, shape = self._formats[name]
            rows = given.astype(dtype, copy=False).reshape(len(given), *shape)
            if name in self._arrays:
                self._arrays[name][row : row + len(rows)] = rows
                continue
            size = dtype.itemsize * int(np.prod(shape, dtype=int))
            assert self._file is not None
            try:
                self._file.seek(self._places[name] + row * size)
                data = memoryview(np.ascontiguousarray(rows).tobytes())
                while data:
                    data = data[self._file.write(data) :]
            except OSError as error:
                raise RecordingError(
                    "run",
                    f"its temporary file cannot be written: {error.strerror}",
                    f"room in {tempfile.gettempdir()}",
                ) from None

    def first_rows(self, rows: int) -> dict[str, np.ndarray]:
        """Return the first rows of all arrays; those in the file are mapped."""
        given: dict[str, np.ndarray] = {}
        for name, (dtype, shape) in self._formats.items():
            if name in self._arrays:
                given[name] = self._arrays[name][:rows]
            elif 0 in shape:
                given[name] = np.zeros((rows, *shape), dtype)
            else:
                assert self._file is not None
                at = self._places[name]
                given[name] = np.memmap(self._file, dtype, "r", at, (rows, *shape))
        return given


def _allocated(rows: int, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    try:
        return np.empty((rows, *shape), dtype)
    except (MemoryError, ValueError):  # ValueError: more than an array may have
        raise InputInvalid(
            "run", f"there is no memory for {rows} rows", "a shorter run, in pieces"
        ) from None
