"""The progress of a run on the terminal: building components once, then simulated time."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Self

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from uuvsim_cosim.commands.terminal import console

__all__ = ["RunProgress"]


class RunProgress:
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
        """Show how far a stage is: components while "building", seconds while "simulating"."""
        if stage != self._stage:
            self._stage, self._began = stage, time.perf_counter()
            self._bar.reset(self._task)
        passed = max(time.perf_counter() - self._began, 1e-9)
        if stage == "building":
            words = f"building {total:.0f} components, once:"
            shown = f"{done:.0f} of {total:.0f}"
        else:
            words = "simulating"
            shown = f"{done:.1f} of {total:g} s, {done / passed:.0f} times real time"
        self._bar.update(self._task, description=words, completed=done, total=total, shown=shown)

    def say(self, words: str) -> None:
        """Show a stage whose end is not known."""
        self._bar.update(self._task, description=words, total=None, shown="")

    def stop(self) -> None:
        """Stop drawing; a second call does nothing."""
        self._bar.stop()
