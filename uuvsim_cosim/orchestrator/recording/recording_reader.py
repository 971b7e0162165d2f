"""Reader of recordings; the result is `Signals`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.recording.files import file_of, metadata_of, read_batches
from uuvsim_cosim.orchestrator.recording.mcap import read_mcap
from uuvsim_cosim.orchestrator.recording.signals import Signals

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["read_signals"]


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
