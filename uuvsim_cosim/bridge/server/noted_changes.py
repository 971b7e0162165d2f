"""Values that clients set during a recorded run: a scenario beside the recording, `changes.yaml`.

With it, and with the axes of its pilots, a run repeats to the bit without its clients.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np

from uuvsim_cosim.bridge.server.signal_names import Fitted

__all__ = ["CHANGES", "NotedChanges"]

CHANGES = "changes.yaml"
_log = logging.getLogger("uuvsim_cosim.changes")


@final
class NotedChanges:
    """The changes of one recording; a value that is set again is no change."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / CHANGES
        self._last: dict[str, object] = {}  # value by name
        self._writes = True

    def note(self, at: float, values: Sequence[Fitted]) -> None:
        """Add the values that are new at time `at` [s]; a full disk is reported once."""
        lines = []
        for place, value in values:
            name, plain = f"{place.path}.{place.variable.name}", np.asarray(value).tolist()
            if self._last.get(name) != plain:
                self._last[name] = plain
                lines.append(f"- {{at: {at!r}, set: {name}, value: {json.dumps(plain)}}}\n")
        if not lines or not self._writes:
            return
        try:
            with self._path.open("a", encoding="utf-8") as file:
                if not file.tell():
                    file.write("events:\n")
                file.writelines(lines)
        except OSError as error:
            self._writes = False
            _log.warning("%s: %s; further changes are not noted", self._path, error.strerror)
