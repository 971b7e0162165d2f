"""Reader of recordings (an Arrow stream, Parquet or MCAP); the result is `Signals`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.recording.columns import LazyArrays, Source, Table, column
from uuvsim_cosim.orchestrator.recording.mcap import read_mcap
from uuvsim_cosim.orchestrator.recording.signals import Signals

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "METADATA",
    "PARQUET",
    "ROW_GROUP",
    "STREAM",
    "Messages",
    "empty_batch",
    "file_of",
    "metadata_of",
    "open_recording",
    "read_batches",
    "read_signals",
]

STREAM, PARQUET = "signals.arrows", "signals.parquet"
METADATA = b"uuvsim"
ROW_GROUP = 16384  # rows of a group of the Parquet file
Messages = Sequence[Sequence[str]]  # of components: path, level, text


def file_of(run: Path) -> Path:
    """Find a recording by its folder or file.

    A stream is looked for first: it is deleted once it is converted, so one that exists belongs
    to a newer run than the Parquet file beside it.
    """
    if run.is_file():
        return run
    for name in (STREAM, PARQUET):
        if (run / name).is_file():
            return run / name
    raise RecordingError(
        run, "no recording here", f"a folder with {PARQUET} or {STREAM}, or such a file"
    )


def empty_batch(schema: pa.Schema) -> pa.RecordBatch:
    """Return a batch without rows."""
    import pyarrow as pa

    return pa.RecordBatch.from_arrays([pa.nulls(0, field.type) for field in schema], schema=schema)


def metadata_of(schema: pa.Schema) -> dict[str, Any]:
    """Return the metadata of a recording's schema."""
    return dict(json.loads((schema.metadata or {}).get(METADATA, b"{}")))


def read_batches(
    file: Path, *, mapped: bool = False
) -> Iterator[tuple[pa.Schema, pa.RecordBatch, Messages]]:
    """Yield (schema, batch, messages) for each batch; a stream may end anywhere.

    The first batch has no rows, so that a recording without rows still has a schema. Batches that
    are kept are best `mapped` to memory; without it, memory holds one batch at a time.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        if file.suffix == ".parquet":
            with pq.ParquetFile(file) as parquet:
                schema = parquet.schema_arrow
                messages = metadata_of(schema).get("messages", [])
                yield schema, empty_batch(schema), messages
                for group in range(parquet.num_row_groups):
                    for batch in parquet.iter_batches(ROW_GROUP, row_groups=[group]):
                        yield schema, batch, []
            return
        opened = pa.memory_map if mapped else pa.OSFile
        with opened(str(file)) as source, pa.ipc.open_stream(source) as reader:
            yield reader.schema, empty_batch(reader.schema), []
            while True:
                try:
                    batch, metadata = reader.read_next_batch_with_custom_metadata()
                except (StopIteration, OSError, ValueError):
                    return  # the end, or the place where the run was killed
                text = (metadata or {}).get("messages")
                yield reader.schema, batch, json.loads(text) if text else []
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:  # Arrow's
        raise RecordingError(
            file,
            f"is no recording, or damaged ({error})",
            "a complete recording, as `uuvsim run` writes it",
        ) from error


def read_signals(run: Path | str) -> Signals:
    """Read the recording of a `run`: its folder, ``.parquet``, ``.mcap``, or a killed run's stream.

    Raises RecordingError for a file that is no recording, or damaged.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> run = uuv.run("bluerov2_hold", until=1.0, out="hold")
    >>> signals = uuv.read_signals("hold")
    >>> signals["guidance.eta_d"].shape, signals.units["guidance.eta_d"]
    ((101, 6), 'm, rad')
    """
    table, signals = open_recording(run)
    if table is None:
        return signals
    return replace(signals, time=column(table, 0), ticks=column(table, 1))


def open_recording(run: Path | str) -> tuple[Table | None, Signals]:
    """Open a recording as `read_signals` does, without reading time and ticks (columns 0 and 1).

    Returns its table, or None for an MCAP file, whose time and ticks have been read.
    """
    import pyarrow as pa

    file = file_of(Path(run))
    if file.suffix.lower() == ".mcap":
        return None, read_mcap(file)
    if file.suffix == ".parquet":
        parquet = _ParquetTable(file)
        stored: Table = parquet
        schema = parquet.schema
        messages = metadata_of(schema).get("messages", [])
    else:
        read = list(read_batches(file, mapped=True))
        schema = read[0][0]
        messages = [m for _, _, texts in read for m in texts]
        stored = _ArrowTable(
            pa.Table.from_batches([b.replace_schema_metadata(None) for _, b, _ in read])
        )
    names, types = schema.names, schema.types  # Arrow makes new lists at each access
    if names[:2] != ["time", "tick"]:
        raise RecordingError(run, "is no recording of signals", "columns time and tick")
    units: dict[str, str] = {}
    descriptions: dict[str, str] = {}
    element_units: dict[str, tuple[str, ...]] = {}
    elements: dict[str, tuple[int, ...]] = {}
    sources: dict[str, Source] = {}
    groups: dict[str, list[int]] = {}  # columns of each variable
    for i in range(2, len(schema)):
        about = _about(schema.field(i))
        name = f"{about['path']}.{about['variable']}" if "variable" in about else names[i]
        groups.setdefault(name, []).append(i)
    for name, numbers in groups.items():
        numbers.sort(key=lambda i: _index(schema.field(i)))
        about = _about(schema.field(numbers[0]))
        is_array = bool(about.get("index"))
        is_number = str(types[numbers[0]]) in ("double", "int64", "uint64", "bool")
        sources[name] = Source(tuple(numbers), is_array, is_number)
        element_units[name] = tuple(_about(schema.field(i)).get("unit", "") for i in numbers)
        if is_array:
            elements[name] = tuple(_index(schema.field(i)) for i in numbers)
        units[name] = ", ".join(dict.fromkeys(element_units[name]))
        descriptions[name] = about.get("description", "")
    metadata = metadata_of(schema) | {"messages": messages}
    values, none = LazyArrays(stored, sources), np.empty(0)
    return stored, Signals(
        none, none, values, units, descriptions, metadata, element_units, elements
    )


@dataclass(frozen=True)
class _ArrowTable:
    """Table in memory, or in a file that is mapped to memory."""

    table: pa.Table

    @property
    def rows(self) -> int:
        return int(self.table.num_rows)

    def parts(self, numbers: Sequence[int]) -> Iterator[pa.RecordBatch]:
        yield from self.table.select(list(numbers)).to_batches()

    def batches(self, most: int) -> Iterator[pa.RecordBatch]:
        yield from self.table.to_batches(max_chunksize=most)


class _ParquetTable:
    """Parquet file, which is read when columns or rows of it are asked for."""

    def __init__(self, file: Path) -> None:
        import pyarrow.parquet as pq

        self._file = file
        try:
            self._parquet = pq.ParquetFile(file)
            self.schema: pa.Schema = self._parquet.schema_arrow
            self._names = self.schema.names  # Arrow makes a new list at each access
        except (OSError, ValueError) as error:
            raise self._problem(error) from error

    @property
    def rows(self) -> int:
        return int(self._parquet.metadata.num_rows)

    def parts(self, numbers: Sequence[int]) -> Iterator[pa.RecordBatch]:
        names = [self._names[number] for number in numbers]
        try:
            for group in range(self._parquet.num_row_groups):
                # A name with dots can stand for more columns than its own.
                rows = self._parquet.read_row_group(group, columns=names, use_threads=False)
                yield from rows.select(names).to_batches()
        except (OSError, ValueError) as error:
            raise self._problem(error) from error

    def batches(self, most: int) -> Iterator[pa.RecordBatch]:
        try:
            # One call for all groups would keep the buffers of those that were read.
            for group in range(self._parquet.num_row_groups):
                yield from self._parquet.iter_batches(most, row_groups=[group], use_threads=False)
        except (OSError, ValueError) as error:
            raise self._problem(error) from error

    def _problem(self, error: Exception) -> RecordingError:
        if isinstance(error, OSError) and error.strerror:
            return RecordingError(f"{self._file}: cannot be read ({error.strerror})")
        return RecordingError(f"{self._file}: is no recording, or damaged ({error})")


def _index(schema_field: pa.Field) -> int:
    """Return the number of an array's element, from 1; 0 if the field has none."""
    text = _about(schema_field).get("index", "")
    return int(text) if text.isdecimal() else 0


def _about(schema_field: pa.Field) -> dict[str, str]:
    return {k.decode(): v.decode() for k, v in (schema_field.metadata or {}).items()}
