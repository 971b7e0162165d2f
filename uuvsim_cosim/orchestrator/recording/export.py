"""Export of a recording as CSV, MATLAB or MCAP file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
from uuvsim_cosim.orchestrator.recording.recording import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["export", "write_csv", "write_mat"]


def export(run: Path | str, target: Path | str) -> Path:
    """Write a recording as ``.csv``, ``.mat`` or ``.mcap``, at once or not at all."""
    target = Path(target)
    writers = {
        ".csv": write_csv,
        ".mat": write_mat,
        ".mcap": write_mcap,
    }
    write = writers.get(target.suffix.lower())
    if write is None:
        raise InputInvalid(
            f"{target}: cannot export to {target.suffix or 'a file without suffix'!r}; expected "
            f"{', '.join(writers)}"
        )
    signals = read_signals(run)
    try:
        with whole_file(target) as fresh:
            write(signals, fresh)
    except OSError as error:
        raise RecordingError(
            f"{target}: cannot be written ({error.strerror or error}); expected a folder that can"
        ) from error
    return target


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


def _scalars(name: str, values: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    columns = values.reshape(len(values), -1).T
    yield from zip(element_names(name, values.shape[1:]), columns, strict=True)


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
