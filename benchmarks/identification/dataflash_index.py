"""Index of a DataFlash log beside pymavlink: CPU time, memory, and all messages one by one.

Give a real log. It is read by both readers and compared. With `--gigabytes 2`, its messages are
repeated to a log of this size, which is indexed alone. Without a file, a small log is written.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import resource
import struct
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.bridge.mavlink.dataflash import DataFlashLog
from uuvsim_cosim.studies.identification.readers.dataflash_reader import DataFlash


def is_same(found: Any, expected: Any) -> bool:
    """Compare a field of both readers; a text ends at its first zero."""
    if isinstance(expected, (bytes, str)):
        text = expected if isinstance(expected, bytes) else expected.encode()
        return bytes(found).split(b"\0")[0] == text.split(b"\0")[0]
    if isinstance(found, np.ndarray):
        return list(found) == list(expected)
    both_nan = np.isnan(found) and np.isnan(expected)
    return bool(found == expected or both_nan)


def compare(path: Path) -> None:
    """Read a log by both readers, and print times and differences."""
    begin = time.process_time()
    mine = DataFlash(path)
    indexed = time.process_time() - begin
    arrays = {name: mine.messages(name) for name in mine.names}
    everything = time.process_time() - begin
    from pymavlink.DFReader import DFReader_binary

    seen: Counter[str] = Counter()
    differences = 0
    begin = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        reader = DFReader_binary(str(path))
        messages = iter(reader.recv_msg, None)
        rows = [(m.get_type(), m._elements) for m in messages]
        reader.close()
    theirs = time.process_time() - begin
    for name, elements in rows:
        place = seen[name]
        seen[name] += 1
        if name not in arrays or place >= len(arrays[name]):
            differences += 1
            continue
        pairs = zip(arrays[name][place], elements, strict=True)
        differences += not all(is_same(a, b) for a, b in pairs)
    counts = {name: mine.count(name) for name in mine.names}
    print(
        f"{path.name}: {path.stat().st_size / 1e6:.2f} MB, {sum(counts.values())} messages of "
        f"{len(counts)} kinds, {mine.lost} bytes lost at {mine.gaps} places, {mine.cut} cut\n"
        f"  CPU: index {indexed:.3f} s, all messages {everything:.3f} s, pymavlink {theirs:.2f} s\n"
        f"  differences: {differences} messages; counts equal: {counts == dict(seen)}"
    )


def repeated(path: Path, size: float, folder: Path) -> Path:
    """Write a log with a log's messages repeated up to a size [bytes]."""
    data = path.read_bytes()
    data = data[: len(data) - DataFlash(path).cut]
    target = folder / "long.BIN"
    with target.open("wb") as file:
        while file.tell() < size:
            file.write(data)
    return target


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", nargs="?", type=Path)
    parser.add_argument("--gigabytes", type=float, default=0.0)
    options = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        path = options.log
        if path is None:
            log = DataFlashLog({"FRAME_CONFIG": 1.0})
            for k in range(2000):
                log.write("BARO", k * 20_000, 0, *struct.unpack("<3f", struct.pack("<3f", k, 1, 2)))
            path = Path(folder) / "short.BIN"
            path.write_bytes(log.data)
        compare(path)
        if options.gigabytes:
            long = repeated(path, options.gigabytes * 1e9, Path(folder))
            begin = time.process_time()
            index = DataFlash(long)
            used = time.process_time() - begin
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
            total = sum(map(index.count, index.names))
            print(
                f"{long.stat().st_size / 1e9:.2f} GB, {total} messages: index {used:.1f} s of CPU "
                f"time, {memory:.2f} GB of memory, {index.lost} bytes lost"
            )


if __name__ == "__main__":
    main()
