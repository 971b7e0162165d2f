"""Signals of a task from a recording, checked for completeness and order."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["Reading", "refuse_times"]

Array = NDArray[np.float64]


def refuse_times(run: Path, time: Array) -> None:
    """Raise InputInvalid for times that are no numbers, or fall.

    Two that are equal may be there: a restart records a communication point twice.
    """
    bad = np.flatnonzero(~np.isfinite(time))
    if len(bad):
        raise InputInvalid(run, f"time {time[bad[0]]:g} in row {bad[0] + 1}", "a number")
    falls = np.flatnonzero(np.diff(time) < 0)
    if len(falls):
        k = falls[0]
        raise InputInvalid(
            run, f"time {time[k + 1]:g} s in row {k + 2}, after {time[k]:g} s", "times that rise"
        )


@final
class Reading:
    """Signals of a task by the names that they have in recordings, where `renamed` gives others.

    `names` are those that the task needs. Raises InputInvalid for others in `renamed`.
    """

    def __init__(self, task: str, names: Mapping[str, int], renamed: Mapping[str, str]) -> None:
        self.task, self._renamed = task, renamed
        for name in renamed:
            if name not in names:
                raise InputInvalid(
                    f"signal {name!r}",
                    f"{task} reads none of this name",
                    expected_names(name, names),
                )

    def finds(self, read: Signals, name: str) -> bool:
        """Return whether a signal is to be read by its name, or by what was given for it."""
        return name in self._renamed or name in read

    def of(self, run: Path, read: Signals, sizes: Mapping[str, int]) -> list[Array]:
        """Return signals of such sizes, each of shape (instants, size).

        Raises InputInvalid that names every element that was not recorded.
        """
        missing: list[str] = []
        bare = False
        for name, size in sizes.items():
            place = self._renamed.get(name, name)
            absent = _absent(read, place, size)
            # A column without Arrow's metadata is a signal with an index in its name.
            bare |= bool(absent) and any(f"{place}[{i + 1}]" in read for i in range(size))
            missing += [a if place == name else f"{a} (given for {name})" for a in absent]
        if missing:
            why = ", or without the Arrow metadata that says what a column holds" if bare else ""
            raise InputInvalid(
                run,
                f"{', '.join(missing)} not recorded{why}",
                (
                    f"what {self.task} reads (a signal of another name is given by "
                    "--signal NAME=RECORDED)"
                ),
            )
        return [
            self._numbers(run, read, self._renamed.get(name, name), size)
            for name, size in sizes.items()
        ]

    def _numbers(self, run: Path, read: Signals, place: str, size: int) -> Array:
        found = read[place]
        columns = found.reshape(len(found), -1) if len(found) else np.zeros((0, size))
        if columns.shape[1] != size:
            raise InputInvalid(
                run, f"{place} has {columns.shape[1]} elements", f"{size}, as {self.task} reads"
            )
        if columns.dtype.kind not in "fiub":
            raise InputInvalid(run, f"{place} holds {type(columns.flat[0]).__name__}", "numbers")
        return np.asarray(columns, float)


def _absent(read: Signals, place: str, size: int) -> list[str]:
    """Return the missing names: the signal, or its elements if the recording lists them."""
    if place not in read:
        return [place]
    there = read.elements.get(place, ())
    return [f"{place}[{i}]" for i in range(1, size + 1) if i not in there] if there else []
