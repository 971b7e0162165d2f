"""Hash of a recorded run: the hash that a page and `uuvsim verify SYSTEM` show for this run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits
from uuvsim_cosim.kernels.verification.ways import TEXTS, outputs_of
from uuvsim_cosim.kernels.web_assembly.output_hash import output_hash
from uuvsim_cosim.orchestrator.plan.flatten import plan_to_inspect
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.running.library import load

__all__ = ["RecordedHash", "hash_of_run"]


@dataclass(frozen=True)
class RecordedHash:
    """Hash of the outputs of a run, its steps, the base step [s], and the number of elements."""

    hash: str
    steps: int
    tick: float
    outputs: int


def hash_of_run(folder: Path) -> RecordedHash:
    """Return the hash of all outputs that the run in a folder has recorded.

    Raises InputInvalid if the recording lacks an output or a communication point.
    """
    file = folder / "system.ssd"
    if not file.is_file():
        raise InputInvalid(folder, "it has no system.ssd", "a folder that `uuvsim run` wrote")
    plan, _ = plan_to_inspect(load(file))
    outputs, tick, signals = outputs_of(plan), float(plan.tick), read_signals(folder)
    rows = len(signals.ticks)
    if not np.array_equal(signals.ticks, np.arange(rows)):
        wanted = f"one row for each {tick:g} s from 0 s on, without --start and --record-every"
        raise InputInvalid(folder, "its rows are not all communication points", wanted)
    refuse_unless_it_fits(
        "the hash", f"{rows:,} rows of {len(outputs)} outputs",
        24.0 * rows * len(outputs), "a run that is {times} times shorter",
    )  # fmt: skip
    parts = []
    for name in dict.fromkeys(
        f"{c.path}.{v.name}"
        for c in plan.components
        for v in c.description.of("output")
        if v.type not in TEXTS
    ):
        if name not in signals:
            raise InputInvalid(folder, f"{name} is not recorded", "a run that records all outputs")
        parts.append(signals[name].reshape(rows, -1).astype(float))
    found = output_hash(np.hstack(parts), [o.whole for o in outputs])
    return RecordedHash(found, rows - 1, tick, len(outputs))
