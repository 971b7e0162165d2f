"""Export of a recording as CSV, MATLAB or MCAP file."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["export", "write_csv", "write_mat"]


def export(run: Path | str, target: Path | str) -> Path:
    """Write a recording as ``.csv``, ``.mat`` or ``.mcap``; never an incomplete file."""
    target = Path(target)
    writers = {".csv": write_csv, ".mat": write_mat, ".mcap": write_mcap}
    write = writers.get(target.suffix.lower())
    if write is None:
        raise InputInvalid(
            target,
            f"cannot export to {target.suffix or 'a file without suffix'!r}",
            ", ".join(writers),
        )
    signals = read_signals(run)
    try:
        with whole_file(target) as fresh:
            write(signals, fresh)
    except OSError as error:
        raise RecordingError(
            target, f"cannot be written ({error.strerror or error})", "a folder that can"
        ) from error
    return target


def write_csv(signals: Signals, file: Path) -> None:
    """Write names in the first line, units in the second, then numbers that read back exactly."""
    import pyarrow as pa
    from pyarrow import csv

    names, units, columns = ["time"], ["s"], [signals.time]
    for name, values in signals.items():
        scalars = values.reshape(len(values), -1).T
        for label, column in zip(element_names(name, values.shape[1:]), scalars, strict=True):
            names.append(label)
            units.append(signals.units.get(name, ""))
            columns.append(column)
    table = pa.table([pa.array(c) for c in columns], names=names)
    with file.open("wb") as out:
        for line in (names, units):
            quoted = ('"' + word.replace('"', '""') + '"' if re.search(r'[",\n]', word) else word
                      for word in line)  # fmt: skip
            out.write((",".join(quoted) + "\n").encode())
        csv.write_csv(table, out, csv.WriteOptions(include_header=False, quoting_style="needed"))


def write_mat(signals: Signals, file: Path) -> None:
    """Write nested structs: ``time``, ``signals.<path>.<variable>``, ``units`` likewise."""
    from scipy.io import savemat

    values: dict[str, object] = {}
    units: dict[str, object] = {}
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


def _nest(tree: dict[str, object], name: str, value: object) -> None:
    """Put a value at ``a.b.c`` of nested dicts, with valid and unique MATLAB names."""
    words = (re.sub(r"\W+", "_", p, flags=re.ASCII).strip("_") for p in name.split("."))
    *path, last = ((word if word[:1].isalpha() else f"x_{word}")[:63] for word in words)
    for part in path:
        below = tree.setdefault(part, {})
        while not isinstance(below, dict):
            part = f"{part}_"
            below = tree.setdefault(part, {})
        tree = below
    while last in tree:
        last = f"{last}_"
    tree[last] = value
