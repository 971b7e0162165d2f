"""The recorder writes what it sees into an Arrow stream, and into Parquet when it closes.

A stream can be read up to its last flush, whatever happened to the run; Parquet, which is
smaller, has no footer until it is closed.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import time
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, final

from uuvsim_cosim._version import __version__
from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.observer import Chunk, Column, seconds
from uuvsim_cosim.orchestrator.plan import Plan
from uuvsim_cosim.orchestrator.recording_files import METADATA, PARQUET, STREAM, to_parquet
from uuvsim_cosim.orchestrator.room import columns_of
from uuvsim_cosim.orchestrator.snapshot import plan_hash

__all__ = ["SCHEMA_VERSION", "Recorder"]

SCHEMA_VERSION = 1
_ROWS, _BYTES = 16384, 1 << 22  # of a batch, at most; of many columns at least 512 rows


@final
class Recorder:
    """Writes ``signals.arrows`` into a folder, flushed each second; ends as ``signals.parquet``.

    Columns: ``time`` [s], ``tick``, then one for each scalar, ``path.variable[i]`` from 1.
    `provenance` (system, seed, …) goes into the metadata, with version, plan and start time.
    """

    def __init__(
        self,
        folder: Path | str,
        *,
        provenance: Mapping[str, Any] | None = None,
        flush_seconds: float = 0.2,
    ) -> None:
        self.folder = Path(folder)
        self._provenance = dict(provenance or {})
        self._flush_seconds = flush_seconds
        self._file: Any = None
        self._messages = _Messages()

    # ---- the observer ---------------------------------------------------------------------

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Open the stream; raises RecordingError if the folder cannot be written."""
        import pyarrow as pa

        self._schema = pa.schema(
            [
                pa.field("time", pa.float64(), metadata={"unit": "s", "causality": "independent"}),
                pa.field("tick", pa.int64(), metadata={"unit": "1"}),
                *(_field(c) for c in columns),
            ],
            metadata={METADATA: json.dumps(self._metadata(plan))},
        )
        self._tick = plan.tick
        self._room = max(512, min(_ROWS, _BYTES // (8 * (len(columns) + 1)) - 16))
        self._kept = columns_of(len(columns) + 1, self._room)  # ticks come last
        self._texts: dict[int, list[Any]] = {i: [] for i, c in enumerate(columns) if c.type.is_blob}
        self._types = self._schema.types[2:]
        self._used = 0
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._file = (self.folder / STREAM).open("wb")
            self._writer = pa.ipc.new_stream(self._file, self._schema)
            # An empty batch: the schema is there from the start, whatever happens then.
            self._writer.write_batch(pa.RecordBatch.from_pylist([], schema=self._schema))
            self._file.flush()
        except OSError as error:
            self._close()
            raise self._failed(error, "a folder that can be written") from error
        self._flushed = -math.inf
        self._messages.listen(c.path for c in plan.components)

    def observe(self, chunk: Chunk) -> None:
        """Keep the rows; writes at first, then when 0.2 s have passed or the batch is full."""
        if self._file is None:  # writing has failed, which has been said
            return
        done, n = 0, len(chunk.ticks)
        while done < n:
            take = min(n - done, self._room - self._used)
            mine, theirs = slice(self._used, self._used + take), slice(done, done + take)
            self._kept[:-1, mine] = chunk.rows[theirs].T
            self._kept[-1, mine] = chunk.ticks[theirs]
            for i, kept in self._texts.items():
                kept.extend(chunk.values(i)[theirs])
            self._used += take
            done += take
            if self._used == self._room:
                self._write()
        if time.monotonic() - self._flushed >= self._flush_seconds:
            self._write()

    def end(self) -> None:
        """Write what is left, and turn the stream into Parquet."""
        if self._file is None:
            return
        try:
            self._write()
            self._writer.close()
        except OSError as error:
            raise self._failed(error, "room on the disk") from error
        finally:
            self._close()
        to_parquet(self.folder / STREAM, self.folder / PARQUET)

    # ---- inside ---------------------------------------------------------------------------

    def _write(self) -> None:
        """Write a batch, with the messages since the last, and flush."""
        import pyarrow as pa

        messages = self._messages.take()
        if self._file is None or not (self._used or messages):
            return
        self._used, n = 0, self._used
        batch = pa.RecordBatch.from_arrays(self._arrays(n), schema=self._schema)
        told = {"messages": json.dumps(messages)} if messages else None
        try:
            self._writer.write_batch(batch, custom_metadata=told)
            self._file.flush()
        except OSError as error:
            self._close()
            raise self._failed(error, "room on the disk") from error
        self._flushed = time.monotonic()

    def _arrays(self, n: int) -> list[Any]:
        """Give the columns of n rows; numbers are not copied."""
        import pyarrow as pa

        memory, apart = pa.py_buffer(self._kept), self._kept.strides[0]
        ticks = self._kept[-1, :n].view("i8")
        arrays = [pa.array(seconds(ticks, self._tick)), pa.array(ticks)]
        for i, type_ in enumerate(self._types):
            if i in self._texts:
                arrays.append(pa.array(self._texts[i], type_))
                self._texts[i].clear()
            elif type_ == pa.bool_():
                arrays.append(pa.array(self._kept[i, :n].astype(bool)))
            else:
                column = memory.slice(i * apart, 8 * n)
                arrays.append(pa.Array.from_buffers(type_, n, [None, column]))
        return arrays

    def _close(self) -> None:
        self._messages.close()
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):  # raised already; what was flushed stays
                file.close()

    def _failed(self, error: OSError, expected: str) -> RecordingError:
        return RecordingError(
            f"recording {self.folder / STREAM}: {error.strerror or error}; expected {expected}"
        )

    def _metadata(self, plan: Plan) -> dict[str, Any]:
        return {
            "schema_version": SCHEMA_VERSION,
            "generator": f"uuvsim-cosim {__version__}",
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "plan": plan_hash(plan),
            "tick": str(plan.tick),
            "warnings": list(plan.warnings),
            **self._provenance,
        }


def _field(column: Column) -> Any:
    import pyarrow as pa

    types = {"f8": pa.float64(), "i8": pa.int64(), "u8": pa.uint64()}
    named = {"Boolean": pa.bool_(), "String": pa.utf8(), "Binary": pa.binary()}
    v = column.variable
    about = {
        "path": column.path,
        "variable": v.name,
        "index": "" if column.index is None else str(column.index),
        "unit": v.unit_of_element((column.index or 1) - 1) or "",
        "description": v.description,
        "causality": v.causality,
    }
    type_ = named.get(column.type.name) or types[column.type.dtype]
    return pa.field(column.name, type_, metadata=about)


class _Messages(logging.Handler):
    """Listens to what components say, and hands it over once."""

    def __init__(self) -> None:
        super().__init__()
        self._kept: list[tuple[str, str, str]] = []
        self._loggers: list[logging.Logger] = []

    def listen(self, paths: Any) -> None:
        self._loggers = [logging.getLogger(f"uuvsim_cosim.{path}") for path in paths]
        for logger in self._loggers:
            logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        if len(self._kept) < 10_000:
            path = record.name.removeprefix("uuvsim_cosim.")
            self._kept.append((path, record.levelname.lower(), record.getMessage()))

    def take(self) -> list[tuple[str, str, str]]:
        kept, self._kept = self._kept, []
        return kept

    def close(self) -> None:
        for logger in self._loggers:
            logger.removeHandler(self)
        self._loggers = []
        super().close()
