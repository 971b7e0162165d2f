"""A recording becomes a CSV or MATLAB file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.orchestrator.recording import Signals

__all__ = ["write_csv", "write_mat"]


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
