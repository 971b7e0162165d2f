"""Progress of stages on the terminal: one bar, which is removed at the end."""

from __future__ import annotations

import time
from abc import abstractmethod
from typing import Self

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.commands.shared.terminal import console

__all__ = ["StageProgress"]


class StageProgress(Closing):
    """A callable ``(stage, done, total)``; nothing is drawn unless stderr is a terminal."""

    def __init__(self) -> None:
        target = console(stderr=True)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[shown]}"),
            TimeRemainingColumn(),
            console=target,
            transient=True,
            disable=not target.is_terminal,
        )
        self._task = self._bar.add_task("", total=1.0, shown="")
        self._stage = ""
        self._began = time.perf_counter()

    @abstractmethod
    def words(self, stage: str, done: float, total: float, passed: float) -> tuple[str, str]:
        """Return what stands before and behind the bar, `passed` seconds after a stage began.

        Nothing behind it says that the stage's end is not known.
        """

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Show how far a stage is."""
        if stage != self._stage:
            self._stage, self._began = stage, time.perf_counter()
            self._bar.reset(self._task)
        passed = max(time.perf_counter() - self._began, 1e-9)
        before, behind = self.words(stage, done, total, passed)
        if not behind:
            self.say(before)
            return
        self._bar.update(self._task, description=before, completed=done, total=total, shown=behind)

    def say(self, words: str) -> None:
        """Show a stage whose end is not known."""
        self._bar.update(self._task, description=words, total=None, shown="")

    def close(self) -> None:
        """Stop drawing; a second call does nothing."""
        self._bar.stop()

    def __enter__(self) -> Self:
        """Begin to draw."""
        self._bar.start()
        return self
