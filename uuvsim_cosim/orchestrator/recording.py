"""A recording is read: signals by name, as numpy arrays, with units and provenance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.orchestrator.recording_files import file_of, metadata_of, read_batches

__all__ = ["Signals", "export", "read_signals"]


@dataclass(frozen=True)
class Signals(Mapping[str, np.ndarray]):
    """Signals by ``path.variable``: (n,) for a scalar, (n, size) for an array.

    `time` (n,) [s]; `ticks` (n,); `units` and `descriptions` by the same names, `element_units`
    with one unit for each element; `metadata` says where the recording came from, and holds what
    components said (``messages``). `elements` are those that an array's columns are, from 1, where
    the recording tells them: a column may have been lost.
    """

    time: np.ndarray
    ticks: np.ndarray
    values_by_name: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    descriptions: Mapping[str, str] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)
    element_units: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    elements: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        """Give a signal; raises InputInvalid with names that come near."""
        if name not in self.values_by_name:
            close = get_close_matches(name, self.values_by_name, n=5, cutoff=0.4)
            near = ", ".join(close or sorted(self.values_by_name)[:10]) or "none: it is empty"
            raise InputInvalid(f"no signal {name!r} in the recording; expected one such as {near}")
        return self.values_by_name[name]

    def __contains__(self, name: object) -> bool:
        """Say whether a signal was recorded."""
        return name in self.values_by_name

    def __iter__(self) -> Iterator[str]:
        """Give the names."""
        return iter(self.values_by_name)

    def __len__(self) -> int:
        """Count the signals."""
        return len(self.values_by_name)


def read_signals(run: Path | str) -> Signals:
    """Read a recording: its folder, ``.parquet``, ``.mcap``, or the stream of a killed run."""
    import pyarrow as pa

    file = file_of(Path(run))
    if file.suffix.lower() == ".mcap":
        from uuvsim_cosim.orchestrator.recording_mcap import read_mcap

        return read_mcap(file)
    read = list(read_batches(file))
    schema = read[0][0]
    messages = [m for _, _, told in read for m in told]
    if schema.names[:2] != ["time", "tick"]:
        raise RecordingError(f"{run}: is no recording of signals; expected columns time and tick")
    batches = [batch.replace_schema_metadata(None) for _, batch, _ in read]
    table = pa.Table.from_batches(batches)
    values: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    descriptions: dict[str, str] = {}
    element_units: dict[str, tuple[str, ...]] = {}
    elements: dict[str, tuple[int, ...]] = {}
    for name, columns in _grouped(schema).items():
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


def _grouped(schema: Any) -> dict[str, list[int]]:
    """Give the columns of each variable; elements of an array come in their order."""
    groups: dict[str, list[int]] = {}
    for i in range(2, len(schema)):
        about = _about(schema.field(i))
        name = f"{about['path']}.{about['variable']}" if "variable" in about else schema.names[i]
        groups.setdefault(name, []).append(i)
    for columns in groups.values():
        columns.sort(key=lambda i: _index(schema.field(i)))
    return groups


def _index(schema_field: Any) -> int:
    """Give the number of an array's element, from 1; 0 where none is told."""
    text = _about(schema_field).get("index", "")
    return int(text) if text.isdecimal() else 0


def _about(schema_field: Any) -> dict[str, str]:
    return {k.decode(): v.decode() for k, v in (schema_field.metadata or {}).items()}


def _array(column: Any) -> np.ndarray:
    array: np.ndarray = column.to_numpy()
    return array


def export(run: Path | str, target: Path | str) -> Path:
    """Write a recording as ``.csv``, ``.mat`` or ``.mcap``, at once or not at all."""
    from uuvsim_cosim.orchestrator import recording_export, recording_mcap

    target = Path(target)
    writers = {
        ".csv": recording_export.write_csv,
        ".mat": recording_export.write_mat,
        ".mcap": recording_mcap.write_mcap,
    }
    write = writers.get(target.suffix.lower())
    if write is None:
        raise InputInvalid(
            f"{target}: cannot export to {target.suffix or 'a file without suffix'!r}; expected "
            f"{', '.join(writers)}"
        )
    signals = read_signals(run)
    fresh = target.with_name(target.name + ".part")
    try:
        write(signals, fresh)
        fresh.replace(target)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise RecordingError(
            f"{target}: cannot be written ({error.strerror or error}); expected a folder that can"
        ) from error
    return target
