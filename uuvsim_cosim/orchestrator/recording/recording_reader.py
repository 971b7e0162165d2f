"""Reader of recordings (an Arrow stream, Parquet or MCAP); the result is `Signals`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.errors import RecordingError
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
    "file_of",
    "metadata_of",
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


def metadata_of(schema: pa.Schema) -> dict[str, Any]:
    """Return the metadata of a recording's schema."""
    return dict(json.loads((schema.metadata or {}).get(METADATA, b"{}")))


def read_batches(file: Path) -> Iterator[tuple[pa.Schema, pa.RecordBatch, Messages]]:
    """Yield (schema, batch, messages) for each batch; a stream may end anywhere.

    The first batch has no rows, so that a recording without rows still has a schema.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        if file.suffix == ".parquet":
            with pq.ParquetFile(file) as parquet:
                schema = parquet.schema_arrow
                messages = metadata_of(schema).get("messages", [])
                yield schema, pa.RecordBatch.from_pylist([], schema=schema), messages
                for batch in parquet.iter_batches(ROW_GROUP):
                    yield schema, batch, []
            return
        with pa.memory_map(str(file)) as source, pa.ipc.open_stream(source) as reader:
            yield reader.schema, pa.RecordBatch.from_pylist([], schema=reader.schema), []
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
        raise RecordingError(f"{file}: is no recording, or damaged ({error})") from error


def read_signals(run: Path | str) -> Signals:
    """Read a recording: its folder, ``.parquet``, ``.mcap``, or the stream of a killed run."""
    import pyarrow as pa

    file = file_of(Path(run))
    if file.suffix.lower() == ".mcap":
        return read_mcap(file)
    read = list(read_batches(file))
    schema = read[0][0]
    messages = [m for _, _, texts in read for m in texts]
    if schema.names[:2] != ["time", "tick"]:
        raise RecordingError(run, "is no recording of signals", "columns time and tick")
    batches = [batch.replace_schema_metadata(None) for _, batch, _ in read]
    table = pa.Table.from_batches(batches)
    values: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    descriptions: dict[str, str] = {}
    element_units: dict[str, tuple[str, ...]] = {}
    elements: dict[str, tuple[int, ...]] = {}
    groups: dict[str, list[int]] = {}  # columns of each variable
    for i in range(2, len(schema)):
        about = _about(schema.field(i))
        name = f"{about['path']}.{about['variable']}" if "variable" in about else schema.names[i]
        groups.setdefault(name, []).append(i)
    for name, columns in groups.items():
        columns.sort(key=lambda i: _index(schema.field(i)))
        arrays = [_array(table.column(i)) for i in columns]
        about = _about(schema.field(columns[0]))
        values[name] = np.stack(arrays, axis=1) if about.get("index") else arrays[0]
        element_units[name] = tuple(_about(schema.field(i)).get("unit", "") for i in columns)
        if about.get("index"):
            elements[name] = tuple(_index(schema.field(i)) for i in columns)
        units[name] = ", ".join(dict.fromkeys(element_units[name]))
        descriptions[name] = about.get("description", "")
    time, ticks = _array(table.column(0)), _array(table.column(1))
    metadata = metadata_of(schema) | {"messages": messages}
    return Signals(time, ticks, values, units, descriptions, metadata, element_units, elements)


def _index(schema_field: pa.Field) -> int:
    """Return the number of an array's element, from 1; 0 if the field has none."""
    text = _about(schema_field).get("index", "")
    return int(text) if text.isdecimal() else 0


def _about(schema_field: pa.Field) -> dict[str, str]:
    return {k.decode(): v.decode() for k, v in (schema_field.metadata or {}).items()}


def _array(column: pa.ChunkedArray) -> np.ndarray:
    array: np.ndarray = column.to_numpy()
    return array
