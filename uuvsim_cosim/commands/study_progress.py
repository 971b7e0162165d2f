"""The progress of a study on the terminal: finished runs, and when the last will be."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from uuvsim_cosim.commands.terminal import console

__all__ = ["StudyProgress"]


class StudyProgress:
    """A callable ``(stage, done, total)``; nothing is drawn unless stderr is a terminal."""

    def __init__(self, counted: str = "runs") -> None:
        self._counted = counted
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

    def __enter__(self) -> Self:
        """Begin to draw."""
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop drawing; the bar vanishes."""
        self.stop()

    def __call__(self, stage: str, done: float, total: float) -> None:
        """Show how far a stage is: nothing to count while "building", runs while "running"."""
        if stage == "building":
            self.say("building, once")
            return
        if stage != self._stage:
            self._stage = stage
            self._bar.reset(self._task)
        shown = f"{done:.0f} of {total:.0f} {self._counted}"
        self._bar.update(self._task, description=stage, completed=done, total=total, shown=shown)

    def say(self, words: str) -> None:
        """Show a stage whose end is not known."""
        self._bar.update(self._task, description=words, total=None, shown="")

    def stop(self) -> None:
        """Stop drawing."""
        self._bar.stop()
