"""The two files of a recording: batches out of either, and the stream turned into Parquet."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import RecordingError

__all__ = ["METADATA", "PARQUET", "STREAM", "file_of", "metadata_of", "read_batches", "to_parquet"]

STREAM, PARQUET = "signals.arrows", "signals.parquet"
METADATA = b"uuvsim"
_ROW_GROUP = 16384


def file_of(run: Path) -> Path:
    """Find a recording by its folder or file; a stream left behind is newer than any Parquet."""
    if run.is_file():
        return run
    for name in (STREAM, PARQUET):
        if (run / name).is_file():
            return run / name
    raise RecordingError(
        f"{run}: no recording here; expected a folder with {PARQUET} or {STREAM}, or such a file"
    )


def metadata_of(schema: Any) -> dict[str, Any]:
    """Return the metadata of a recording's schema."""
    return dict(json.loads((schema.metadata or {}).get(METADATA, b"{}")))


def read_batches(file: Path) -> Iterator[tuple[Any, Any, list[Any]]]:
    """Return (schema, batch, messages) for each batch; a stream may end anywhere.

    The first has no rows, so that a recording without any still has a schema.
    """
    try:
        if file.suffix == ".parquet":
            yield from _read_parquet(file)
        else:
            yield from _read_stream(file)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:  # Arrow's
        raise RecordingError(f"{file}: is no recording, or damaged ({error})") from error


def _read_parquet(file: Path) -> Iterator[tuple[Any, Any, list[Any]]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    with pq.ParquetFile(file) as parquet:
        schema = parquet.schema_arrow
        messages = metadata_of(schema).get("messages", [])
        yield schema, pa.RecordBatch.from_pylist([], schema=schema), messages
        for batch in parquet.iter_batches(_ROW_GROUP):
            yield schema, batch, []


def _read_stream(file: Path) -> Iterator[tuple[Any, Any, list[Any]]]:
    import pyarrow as pa

    with pa.memory_map(str(file)) as source, pa.ipc.open_stream(source) as reader:
        yield reader.schema, pa.RecordBatch.from_pylist([], schema=reader.schema), []
        while True:
            try:
                batch, metadata = reader.read_next_batch_with_custom_metadata()
            except (StopIteration, OSError, ValueError):
                return  # the end, or where the run was killed
            text = (metadata or {}).get("messages")
            yield reader.schema, batch, json.loads(text) if text else []


def to_parquet(stream: Path, parquet: Path) -> None:
    """Turn a stream into Parquet, batch by batch; the stream goes when that is complete."""
    messages = [m for _, _, texts in read_batches(stream) for m in texts]
    try:
        with whole_file(parquet) as fresh:
            _write_parquet(stream, fresh, messages)
        stream.unlink()
    except OSError as error:
        raise RecordingError(
            f"recording {parquet}: {error.strerror or error}; expected room on the disk; "
            f"everything is in {stream.name}, which can be read as well"
        ) from error


def _write_parquet(stream: Path, parquet: Path, messages: list[Any]) -> None:
    """Write row groups of even size, whatever the batches; memory holds one at a time."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    batches = read_batches(stream)
    schema, _, _ = next(batches)
    schema = _with_messages(schema, messages)
    floats = [f.name for f in schema if pa.types.is_float64(f.type)]
    texts = [f.name for f in schema if pa.types.is_string(f.type) or pa.types.is_binary(f.type)]
    # Measured on 50,000 rows of 150 signals, smooth, noisy and held (60 MB): 34 MB in 0.3 s;
    # without splitting bytes 40 MB, with dictionaries 49 MB.
    with pq.ParquetWriter(
        parquet, schema, compression="zstd", use_dictionary=texts, use_byte_stream_split=floats
    ) as writer:
        waiting: list[Any] = []
        for _, batch, _ in batches:
            waiting.append(batch)
            if sum(b.num_rows for b in waiting) >= _ROW_GROUP:
                writer.write_table(_table(waiting, schema), _ROW_GROUP)
                waiting.clear()
        if any(b.num_rows for b in waiting):
            writer.write_table(_table(waiting, schema), _ROW_GROUP)


def _table(batches: list[Any], schema: Any) -> Any:
    import pyarrow as pa

    return pa.Table.from_batches(batches).replace_schema_metadata(schema.metadata)


def _with_messages(schema: Any, messages: list[Any]) -> Any:
    metadata = metadata_of(schema) | {"messages": messages}
    return schema.with_metadata({METADATA: json.dumps(metadata)})
