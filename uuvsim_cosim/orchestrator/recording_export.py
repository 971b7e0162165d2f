"""A recording becomes a CSV, MATLAB or MCAP file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.orchestrator.recording import Signals

__all__ = ["write_csv", "write_mat", "write_mcap"]


def write_csv(signals: Signals, file: Path) -> None:
    """Write names in the first line, units in the second, then numbers that read back exactly."""
    import pyarrow as pa
    from pyarrow import csv

    names, units, columns = ["time"], ["s"], [signals.time]
    for name, values in signals.items():
        for label, column in _scalars(name, values):
            names.append(label)
            units.append(signals.units.get(name, ""))
            columns.append(column)
    table = pa.table([pa.array(c) for c in columns], names=names)
    with file.open("wb") as out:
        for line in (names, units):
            out.write((",".join(_quoted(word) for word in line) + "\n").encode())
        csv.write_csv(table, out, csv.WriteOptions(include_header=False, quoting_style="needed"))


def write_mat(signals: Signals, file: Path) -> None:
    """Write nested structs: ``time``, ``signals.<path>.<variable>``, ``units`` likewise."""
    from scipy.io import savemat

    values: dict[str, Any] = {}
    units: dict[str, Any] = {}
    for name, array in signals.items():
        kept = array if array.dtype != object else np.array(array, dtype=object)
        _nest(values, name, kept[:, None] if kept.ndim == 1 else kept)
        _nest(units, name, signals.units.get(name, ""))
    content = {
        "time": signals.time[:, None],
        "signals": values,
        "units": units,
        "metadata": json.dumps(dict(signals.metadata)),
    }
    savemat(str(file), content, appendmat=False, long_field_names=True, do_compression=True)


def write_mcap(signals: Signals, file: Path) -> None:
    """Write one channel for each component, with a JSON schema; time 0 is the log's epoch."""
    from mcap.writer import Writer

    groups: dict[str, list[str]] = {}
    for name in signals:
        groups.setdefault(name.rpartition(".")[0], []).append(name)
    nanoseconds = np.rint(signals.time * 1e9).astype(np.int64)
    with file.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="", library="uuvsim-cosim")
        writer.add_metadata("uuvsim", {"recording": json.dumps(dict(signals.metadata))})
        channels = {}
        for path, names in groups.items():
            schema = json.dumps(_json_schema(path, names, signals)).encode()
            id_ = writer.register_schema(name=path, encoding="jsonschema", data=schema)
            channels[path] = writer.register_channel(
                topic=f"/{path.replace('.', '/')}", message_encoding="json", schema_id=id_
            )
        lists = {name: values.tolist() for name, values in signals.items()}
        for k, at in enumerate(nanoseconds.tolist()):
            for path, names in groups.items():
                message = {n.rpartition(".")[2]: lists[n][k] for n in names}
                data = json.dumps(message, default=str).encode()
                writer.add_message(channels[path], log_time=at, publish_time=at, data=data)
        writer.finish()


def _json_schema(path: str, names: list[str], signals: Signals) -> dict[str, Any]:
    properties: dict[str, Any] = {}
    for name in names:
        kind = {"b": "boolean", "i": "integer", "u": "integer", "O": "string"}
        scalar: dict[str, Any] = {"type": kind.get(signals[name].dtype.kind, "number")}
        told = f"{signals.descriptions.get(name, '')} [{signals.units.get(name, '')}]".strip()
        shaped = {"type": "array", "items": scalar} if signals[name].ndim == 2 else scalar
        properties[name.rpartition(".")[2]] = {**shaped, "description": told}
    return {"title": path, "type": "object", "properties": properties}


def _scalars(name: str, values: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    if values.ndim == 1:
        yield name, values
    else:
        for i in range(values.shape[1]):
            yield f"{name}[{i + 1}]", values[:, i]


def _quoted(word: str) -> str:
    return '"' + word.replace('"', '""') + '"' if re.search(r'[",\n]', word) else word


def _nest(tree: dict[str, Any], name: str, value: Any) -> None:
    """Put a value at ``a.b.c``, with names that MATLAB allows, and no two the same."""
    *path, last = (_matlab_name(part) for part in name.split("."))
    for part in path:
        below = tree.setdefault(part, {})
        while not isinstance(below, dict):
            part = f"{part}_"
            below = tree.setdefault(part, {})
        tree = below
    while last in tree:
        last = f"{last}_"
    tree[last] = value


def _matlab_name(part: str) -> str:
    name = re.sub(r"\W+", "_", part, flags=re.ASCII).strip("_")
    return (name if name[:1].isalpha() else f"x_{name}")[:63]
