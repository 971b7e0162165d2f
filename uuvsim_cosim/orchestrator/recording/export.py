"""Export of a recording as CSV, MATLAB or MCAP file."""

from __future__ import annotations

import itertools
import json
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid, RecordingError
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["export", "refuse_if_disk_is_small", "write_csv", "write_mat"]

# Bytes of a recorded number, about, in a file, and for .mat in the temporary file beside it.
_BYTES = {".csv": 15, ".mat": 12, ".mcap": 7, ".rrd": 10}


def export(run: Path | str, target: Path | str, progress: Progress | None = None) -> Path:
    """Write a recording as ``.csv``, ``.mat`` or ``.mcap``; never an incomplete file.

    ``progress("writing", done, total)`` counts rows, and signals in a ``.mat``. Raises InputInvalid
    for another format, and before it writes anything if the disk has too little space.
    """
    target = Path(target)
    kind = target.suffix.lower()
    writers: dict[str, Callable[..., None]] = {
        ".csv": write_csv, ".mat": write_mat, ".mcap": write_mcap,
    }  # fmt: skip
    if kind not in writers:
        raise InputInvalid(
            target,
            f"cannot export to {target.suffix or 'a file without suffix'!r}",
            ", ".join(writers),
        )
    signals = read_signals(run)
    try:
        refuse_if_disk_is_small(signals, target)
        with whole_file(target) as fresh:
            writers[kind](signals, fresh, progress=progress)
    except OSError as error:
        raise RecordingError(
            target, f"cannot be written ({error.strerror or error})", "a folder that can be written"
        ) from error
    return target


def refuse_if_disk_is_small(signals: Signals, target: Path) -> None:
    """Raise InputInvalid if the disk cannot hold a recording in the format of the file `target`."""
    first = next(signals.blocks(), signals)
    numbers = len(signals.time) * sum(first[name][:1].size for name in first)
    refuse_unless_it_fits(
        target,
        "the file",
        _BYTES[target.suffix.lower()] * numbers,
        "another folder, or a recording with fewer rows (uuvsim run --record-every {times})",
        folder=target.absolute().parent,
    )


def write_csv(signals: Signals, file: Path, progress: Progress | None = None) -> None:
    """Write names in the first line, units in the second, then numbers that read back exactly."""
    import pyarrow as pa
    from pyarrow import csv

    names, units = ["time"], ["s"]
    first = next(signals.blocks(), signals)
    for name, values in first.items():
        labels = element_names(name, values.shape[1:])
        names += labels
        units += [signals.units.get(name, "")] * len(labels)
    with file.open("wb") as out:
        for line in (names, units):
            quoted = ('"' + word.replace('"', '""') + '"' if re.search(r'[",\n]', word) else word
                      for word in line)  # fmt: skip
            out.write((",".join(quoted) + "\n").encode())
        options = csv.WriteOptions(include_header=False, quoting_style="needed")
        for block in signals.blocks(progress):
            columns = [block.time]
            for values in block.values():
                columns += list(values.reshape(len(values), -1).T)
            csv.write_csv(pa.table([pa.array(c) for c in columns], names=names), out, options)


class _Stored:
    """Signal (n, size) that is read when SciPy writes it."""

    def __init__(self, signals: Signals, name: str, read: Callable[[], None]) -> None:
        self._signals, self._name, self._read = signals, name, read

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        self._read()
        array = self._signals[self._name]
        kept = array if array.dtype != object else np.array(array, dtype=object)
        return kept[:, None] if kept.ndim == 1 else kept


def write_mat(signals: Signals, file: Path, progress: Progress | None = None) -> None:
    """Write nested structs: ``time``, ``signals.<path>.<variable>``, ``units`` likewise.

    Memory holds one signal at a time. The folder holds a temporary file with the uncompressed
    content meanwhile.
    """
    from scipy.io import savemat

    values: dict[str, object] = {}
    units: dict[str, object] = {}
    count = itertools.count()

    def read() -> None:
        if progress is not None:
            progress("writing", min(next(count), len(signals)), len(signals))

    for name in signals:
        _nest(values, name, _Stored(signals, name, read))
        _nest(units, name, signals.units.get(name, ""))
    content = {
        "time": signals.time[:, None],
        "signals": values,
        "units": units,
        "metadata": json.dumps(dict(signals.metadata)),
    }
    with TemporaryFile(dir=file.parent) as plain, file.open("wb") as out:
        # SciPy compresses a whole variable at once, and all signals are one variable.
        savemat(plain, content, long_field_names=True)  # type: ignore[arg-type]
        plain.seek(0)
        out.write(plain.read(_MAT_HEADER))
        while tag := plain.read(_MAT_TAG.size):
            _compress_variable(tag, plain, out)


_MAT_HEADER, _MAT_TAG, _MAT_COMPRESSED = 128, struct.Struct("=II"), 15


def _compress_variable(tag: bytes, plain: IO[bytes], out: IO[bytes]) -> None:
    """Copy a variable of a MAT file, of which `tag` was read, as a compressed one."""
    begin, packing = out.tell(), zlib.compressobj()
    out.write(bytes(_MAT_TAG.size))
    out.write(packing.compress(tag))
    left = _MAT_TAG.unpack(tag)[1]
    while left:
        part = plain.read(min(left, 1 << 20))
        out.write(packing.compress(part))
        left -= len(part)
    out.write(packing.flush())
    end = out.tell()
    out.seek(begin)
    out.write(_MAT_TAG.pack(_MAT_COMPRESSED, end - begin - _MAT_TAG.size))
    out.seek(end)


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
