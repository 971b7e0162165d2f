"""Sinks for the rows of a single FMU's simulation: memory, or a CSV file."""

from __future__ import annotations

import contextlib
import csv
import time
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Protocol, TextIO, final

import numpy as np

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits

__all__ = ["ColumnRows", "CsvRows", "Rows", "check_room"]

_FLUSH = 0.2  # [s] between two flushes; a process that is killed loses the rows of this time
_CELL = 20  # approximate bytes of a number in a CSV file


class Rows(Protocol):
    """A receiver of the values of one communication point after the other."""

    count: int
    last_time: float

    def add(self, t: float, values: Sequence[np.ndarray]) -> None:
        """Add the values at time `t` [s], one for each variable."""


@final
class ColumnRows:
    """Rows in memory, as one array for each variable, of shape (count, *shape)."""

    def __init__(self, variables: Sequence[Variable]) -> None:
        self._variables = variables
        self._time = np.empty(64)
        self._columns = [np.empty((64, *v.shape), DTYPES[v.type]) for v in variables]
        self.count = 0
        self.last_time = -np.inf

    @property
    def time(self) -> np.ndarray:
        """Times [s], of shape (count,)."""
        return self._time[: self.count].copy()

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """Values by name."""
        pairs = zip(self._variables, self._columns, strict=True)
        return {v.name: column[: self.count].copy() for v, column in pairs}

    def add(self, t: float, values: Sequence[np.ndarray]) -> None:
        """Add a row; raises RecordingError if there is no memory for more."""
        if self.count == len(self._time):
            try:
                self._time = _doubled(self._time)
                self._columns = [_doubled(column) for column in self._columns]
            except MemoryError:
                raise RecordingError(
                    f"no memory for more than {self.count} rows, at t = {t:g} s",
                    "an earlier end, a longer step, or simulate_fmu_to_csv, which keeps no rows",
                ) from None
        self._time[self.count] = t
        for column, value in zip(self._columns, values, strict=True):
            column[self.count] = value
        self.count += 1
        self.last_time = t


def _doubled(column: np.ndarray) -> np.ndarray:
    longer = np.empty((2 * len(column), *column.shape[1:]), column.dtype)
    longer[: len(column)] = column
    return longer


@final
class CsvRows(Closing):
    """Rows in a CSV file, which is created with the first row; `shown` is its name in messages.

    Numbers are written with all bits. A row is on the disk after 0.2 s, even if the process dies.
    """

    def __init__(
        self, path: Path, variables: Sequence[Variable], shown: Path | None = None
    ) -> None:
        self._path, self._shown = path, shown or path
        self._names = ["time", *(n for v in variables for n in v.element_names)]
        self._file: TextIO | None = None
        self._flushed = 0.0
        self.count = 0
        self.last_time = -np.inf

    def add(self, t: float, values: Sequence[np.ndarray]) -> None:
        """Write a row; raises InputInvalid for a file that cannot be made, RecordingError later."""
        if self._file is None:
            try:
                self._file = self._path.open("w", newline="", encoding="utf-8")
            except OSError as error:
                raise InputInvalid(f"{self._shown}: cannot be written ({error.strerror})") from None
            csv.writer(self._file).writerow(self._names)
            self._flush(self._file)
        try:
            cells = (x for value in values for x in np.asarray(value).ravel().tolist())
            csv.writer(self._file).writerow([repr(t), *map(_text, cells)])
            if time.monotonic() - self._flushed > _FLUSH:
                self._flush(self._file)
        except OSError as error:
            raise RecordingError(
                self._shown,
                f"{error.strerror or error} at t = {t:g} s",
                "free space on the disk; the file contains the rows up to that time, and the last "
                "may be incomplete",
            ) from None
        self.count += 1
        self.last_time = t

    def close(self) -> None:
        """Write the rows that are still buffered; a second call does nothing."""
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def _flush(self, file: TextIO) -> None:
        file.flush()
        self._flushed = time.monotonic()


def check_room(target: Path, rows: int, variables: Sequence[Variable]) -> None:
    """Refuse a CSV file of `rows` rows that the disk cannot hold; raises InputInvalid."""
    wanted = rows * _CELL * (1 + sum(v.size for v in variables))
    with contextlib.suppress(OSError):  # creating the file raises the error
        refuse_unless_it_fits(
            target,
            f"its {Decimal(rows):.3g} rows",
            wanted,
            "an earlier end (--until) or a longer step (--step)",
            folder=target.absolute().parent,
        )


def _text(value: object) -> str:
    """Return a value as the text of a CSV cell; bytes in hexadecimal, Booleans as 0 and 1."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, bool):
        return str(int(value))
    return value if isinstance(value, str) else repr(value)
