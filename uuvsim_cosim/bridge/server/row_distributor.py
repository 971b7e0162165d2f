"""Distribution of the rows of the running master to subscribers, and to a recording if wanted.

Each run, from a start to the next reset, restore or replacement, has its own recording, so that
time never goes back within a recording.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import final

from uuvsim_cosim.bridge.server.noted_changes import NotedChanges
from uuvsim_cosim.bridge.server.signal_names import Fitted
from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column, Observer
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.recording.recorder import Recorder
from uuvsim_cosim.orchestrator.running.run_folder import lock_run_folder

__all__ = ["RowDistributor"]


@final
class RowDistributor:
    """The only observer of each master in turn, which passes rows to other observers.

    `record` is the folder for recordings: each gets the first of NAME, NAME-2, … that is free.
    """

    def __init__(self, record: Path | None, provenance: Mapping[str, object]) -> None:
        self._record = record
        self._provenance = dict(provenance)
        self._observers: list[Observer] = []
        self._recorder: Recorder | None = None
        self._changes: NotedChanges | None = None
        self._plan: Plan | None = None
        self.columns: Sequence[Column] = ()
        self.folders: list[Path] = []

    def add(self, observer: Observer) -> None:
        """Pass rows to an observer from now on."""
        if self._plan is not None:
            observer.begin(self._plan, self.columns)
        self._observers.append(observer)

    def remove(self, observer: Observer) -> None:
        """Stop passing rows to an observer, and end it."""
        if observer in self._observers:
            self._observers.remove(observer)
            observer.end()

    def fresh(self) -> None:
        """Complete the recording, and begin the next one in its own folder."""
        self.close()
        if self._record is None or self._plan is None:
            return
        folder = lock_run_folder(self._record)
        self.folders.append(folder.path)
        self._changes = NotedChanges(folder.path)
        self._recorder = Recorder(folder.path, provenance=self._provenance)
        self._recorder.begin(self._plan, self.columns)

    def note(self, at: float, values: Sequence[Fitted]) -> None:
        """Add values that a client has set at time `at` [s] to the recording, if there is one."""
        if self._changes is not None:
            self._changes.note(at, values)

    def close(self) -> None:
        """Complete the recording."""
        recorder, changes = self._recorder, self._changes
        self._recorder = self._changes = None
        if changes is not None:
            changes.close()
        if recorder is not None:
            recorder.end()

    # ---- the observer ---------------------------------------------------------------------

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Keep the columns of a new master's rows, and begin a new recording."""
        self._plan, self.columns = plan, columns
        self.fresh()
        for observer in self._observers:
            observer.begin(plan, columns)

    def observe(self, chunk: Chunk) -> None:
        """Pass the rows on, to the recording first."""
        if self._recorder is not None:
            try:
                self._recorder.observe(chunk)
            except RecordingError:
                self._recorder = None  # a full disk, for example: it is reported only once
                raise
        for observer in self._observers:
            observer.observe(chunk)

    def end(self) -> None:
        """Do nothing: `close` completes the recording."""
