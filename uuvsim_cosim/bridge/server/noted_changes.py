"""Values that clients set during a recorded run: a scenario beside the recording, `changes.yaml`.

With it, and with the axes of its pilots, a run repeats to the bit without its clients.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TextIO, final

import numpy as np

from uuvsim_cosim.bridge.server.signal_names import Fitted
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, changes_text

__all__ = ["CHANGES", "NotedChanges"]

CHANGES = "changes.yaml"
_log = logging.getLogger("uuvsim_cosim.changes")


@final
class NotedChanges:
    """The changes of one recording; a value that is set again is no change.

    They are with the operating system when `note` returns: a program that is killed loses none.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / CHANGES
        self._file: TextIO | None = None  # from the first change on
        self._last: dict[str, object] = {}  # value by name
        self._writes = True

    def note(self, at: float, values: Sequence[Fitted]) -> None:
        """Add the values that are new at time `at` [s]; a full disk is reported once."""
        changes = []
        for place, value in values:
            name, plain = f"{place.path}.{place.variable.name}", np.asarray(value).tolist()
            if self._last.get(name) != plain:
                self._last[name] = plain
                changes.append(Change(at, name, plain))
        if not changes or not self._writes:
            return
        try:
            begins = self._file is None
            self._file = self._file or self._path.open("w", encoding="utf-8")
            self._file.write(changes_text(changes, begins=begins))
            self._file.flush()
        except OSError as error:
            self._writes = False
            _log.warning("%s: %s; further changes are not noted", self._path, error.strerror)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            with suppress(OSError):  # the disk is full, which `note` has reported
                self._file.close()
