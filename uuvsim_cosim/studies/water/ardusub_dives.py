"""Dives of ArduSub logs, joined to one recording: each log with its excluded parts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.studies.identification.exclusions import Excluded
from uuvsim_cosim.studies.identification.logs import read_log

__all__ = ["read_dives"]

Array = NDArray[np.float64]
_BETWEEN = 10.0  # s between two dives
_NAMES = ("eta", "nu", "u", "voltage")


def read_dives(files: list[Path]) -> Signals:
    """Read logs of one vehicle (.BIN, .tlog) one after the other; raises InputInvalid."""
    times: list[Array] = []
    values: dict[str, list[Array]] = {name: [] for name in _NAMES}
    excluded: list[Excluded] = []
    metadata: dict[str, object] = {}
    start = 0.0
    for file in files:
        log = read_log(file)
        vehicle = metadata.setdefault("vehicle", log.metadata["vehicle"])
        if log.metadata["vehicle"] != vehicle:
            raise InputInvalid(file, f"a log of {log.metadata['vehicle']}", str(vehicle))
        metadata = {"frame": log.metadata["frame"], **metadata}
        excluded += [
            Excluded(start + e.first, start + e.last, e.reason)
            for e in log.metadata.get("excluded", ())
        ]
        times.append(start + log.time)
        for name in _NAMES:
            values[name].append(np.asarray(log[name], dtype=float))
        end = float(times[-1][-1])
        excluded.append(Excluded(end, end + _BETWEEN, "between two dives"))
        start = end + _BETWEEN
    time = np.concatenate(times)
    joined = {name: np.concatenate(parts) for name, parts in values.items()}
    return Signals(
        time, np.arange(len(time)), joined, {}, metadata={**metadata, "excluded": excluded}
    )
