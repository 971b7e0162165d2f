"""A run in progress: to a time or without end, as fast as possible or in real time."""

from __future__ import annotations

import io
import shutil
import tempfile
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.playback import Stepped
from uuvsim_cosim.bridge.server.signal_names import Place
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.orchestrator.master.core_library import Type
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Record", "Running", "Store"]

_SECONDS = 0.01  # of wall time between two checks of the queue, in a run as fast as possible
_WAKES = 1000.0  # [1/s] at most: shorter communication steps are made several at a time
_MOST = 1000  # steps that are made at once at most; calls wait meanwhile
_MEMORY = 8 << 20  # bytes of recorded signals that are kept in memory
_IN_PROCESS = 1 << 30  # bytes of `time` that a run without signals keeps for this process
_HOPELESS = 1.0  # [s] of delay behind the clock beyond which the schedule is shifted instead


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
                try:
                    self._arrays[name] = np.empty((rows, *shape), dtype)
                except (MemoryError, ValueError):  # ValueError: more than an array may have
                    raise InputInvalid(
                        "run", f"there is no memory for {rows} rows", "a shorter run, in pieces"
                    ) from None
        if size:
            free = shutil.disk_usage(tempfile.gettempdir()).free
            if size > free // 2:
                raise InputInvalid(
                    "run",
                    (
                        f"its recording takes {size} bytes of a temporary file, and {free} "
                        f"are free in {tempfile.gettempdir()}"
                    ),
                    "twice that number: record fewer signals, or run in pieces",
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


@final
class Record:
    """Recorded signals of a run, one row for each communication point; an observer of its rows.

    Their size is known before the run: more than `most` bytes are refused. For a client in another
    process (`most` is given), more than `_MEMORY` bytes are kept in a temporary file.
    """

    def __init__(
        self,
        places: Mapping[str, Place],
        columns: Sequence[Column],
        read: Callable[[Place], Any],
        master: Stepped,
        rows: int,
        most: int | None = None,
    ) -> None:
        found = {(c.path, c.variable.name, c.index): i for i, c in enumerate(columns)}
        self._columns: dict[str, list[int]] = {}
        self._read, self._places = read, places
        for name, place in places.items():
            v = place.variable
            elements = range(v.size) if place.element is None else [place.element]
            keys = [(place.path, v.name, e + 1 if v.shape else None) for e in elements]
            if all(key in found for key in keys):
                self._columns[name] = [found[key] for key in keys]
        row = 1 + sum(_size(place) for place in places.values())
        size = 8 * rows * row
        if most is not None and places and size > most:
            raise InputInvalid(
                "run",
                f"{rows} rows of {row} numbers are {size} bytes",
                (
                    f"at most {most}: record fewer signals, run in pieces, or read the "
                    "recording of the server"
                ),
            )
        formats: dict[str, tuple[np.dtype, tuple[int, ...]]] = {}
        if places or size <= (_MEMORY if most is not None else _IN_PROCESS):
            formats["time"] = (np.dtype("f8"), ())
        for name, place in places.items():
            type_ = Type.of(place.variable)
            dtype = "O" if type_.is_blob else "?" if type_ == Type.Boolean else type_.dtype
            shape = place.variable.shape if place.element is None else ()
            formats[name] = np.dtype(dtype), shape
        self._store = Store(rows, formats, in_file=most is not None and size > _MEMORY)
        self._has_time, self._rows = "time" in formats, 0
        self._first = self._last = master.time
        self._put(1, np.array([master.time]), {})

    @property
    def each_step(self) -> bool:
        """Whether steps must be made one at a time, to read values that are not in the rows."""
        return len(self._columns) < len(self._places)

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Do nothing: the columns are known."""

    def observe(self, chunk: Chunk) -> None:
        """Store the rows."""
        values = {
            name: np.stack([chunk.values(i) for i in columns], 1)
            for name, columns in self._columns.items()
        }
        self._put(len(chunk.ticks), chunk.time, values)

    def _put(self, n: int, time_: np.ndarray, values: dict[str, np.ndarray]) -> None:
        """Store n rows; values that are not in the rows are read from the master now."""
        for name, place in self._places.items():
            if name not in values:
                value = np.array(self._read(place), object if _is_text(place) else None)
                values[name] = np.broadcast_to(value, (n, *value.shape))
        if self._has_time:
            values["time"] = time_
        self._store.put(self._rows, values)
        self._rows += n
        self._last = float(time_[-1])

    def end(self) -> None:
        """Do nothing: there is nothing to close."""

    def result(self) -> dict[str, np.ndarray]:
        """Return the time and the signals.

        A run that records no signals has a row of `time` for each communication point, or only the
        first and the last if these are too many.
        """
        given = self._store.first_rows(self._rows)
        return given if self._has_time else {"time": np.array([self._first, self._last]), **given}


def _size(place: Place) -> int:
    """Return the size of a value in numbers of 8 bytes."""
    size = place.variable.size if place.element is None else 1
    return 8 * size if _is_text(place) else size  # an estimate: a Python object with some letters


def _is_text(place: Place) -> bool:
    return Type.of(place.variable).is_blob


@final
class Running:
    """A run to the tick `end` (None: without end), at `factor` of real time if that is given."""

    def __init__(
        self,
        master: Stepped,
        end: int | None,
        factor: float | None,
        answer: Answer | None,
        record: Record | None,
        finish: Callable[[], object],
    ) -> None:
        if factor is not None and not 0.0 < factor < float("inf"):
            raise InputInvalid("run", f"factor {factor:g}", "more than 0")
        self.answer, self.record, self.finish = answer, record, finish
        self.factor = factor
        self.overruns = 0
        self.hurries = factor is None  # steps do not wait for the clock
        self.busy = 0.0  # [s] of wall time in steps
        self._master, self._end = master, end
        self._first, self._begun = master.tick, time.perf_counter()
        self._period = 0.0 if factor is None else float(master.plan.tick) / factor
        due = ceil(min(_MOST, 1.0 / (_WAKES * self._period))) if self._period else 8
        self._each = max(1, due)
        if record is not None and record.each_step:
            self._each = 1

    @property
    def is_over(self) -> bool:
        """Whether the run has reached its end."""
        return self._end is not None and self._master.tick >= self._end

    @property
    def wait(self) -> float:
        """The time until the next step is due [s of wall time]."""
        if not self._period:
            return 0.0
        due = self._begun + (self._master.tick - self._first) * self._period
        return due - time.perf_counter()

    def advance(self) -> None:
        """Make the steps that are due now."""
        begun = time.perf_counter()
        n = self._each if self._end is None else min(self._each, self._end - self._master.tick)
        self._master.step(n)
        took = time.perf_counter() - begun
        self.busy += took
        if not self._period:
            if self.record is None or not self.record.each_step:
                # As many steps as fit into `_SECONDS`, so that calls do not wait longer.
                wanted = int(self._each * _SECONDS / max(took, 1e-6))
                self._each = max(1, min(4 * self._each, wanted))
            return
        behind = -self.wait
        self.hurries = behind > 0.0
        if behind > 0.0:
            self.overruns += 1
            if behind > _HOPELESS:
                self._begun += behind
