"""Progress of a run or a study on the terminal: one bar, which is removed at the end."""

from __future__ import annotations

import time
from abc import abstractmethod
from typing import Self, final

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.commands.shared.terminal import console

__all__ = ["FitProgress", "PhaseProgress", "RunProgress", "StudyProgress"]


class PhaseProgress(Closing):
    """A callable ``(phase, done, total)``; nothing is drawn unless stderr is a terminal."""

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
        self._phase = ""
        self._start = time.perf_counter()

    @abstractmethod
    def words(self, phase: str, done: float, total: float, elapsed: float) -> tuple[str, str]:
        """Return the texts before and behind the bar, `elapsed` seconds after the phase began.

        Without a text behind it, the end of the phase is not known.
        """

    def __call__(self, phase: str, done: float, total: float) -> None:
        """Show the progress of a phase."""
        if phase != self._phase:
            self._phase, self._start = phase, time.perf_counter()
            self._bar.reset(self._task)
        elapsed = max(time.perf_counter() - self._start, 1e-9)
        before, behind = self.words(phase, done, total, elapsed)
        if not behind:
            self.say(before)
            return
        self._bar.update(self._task, description=before, completed=done, total=total, shown=behind)

    def say(self, words: str) -> None:
        """Show a phase whose end is not known."""
        self._bar.update(self._task, description=words, total=None, shown="")

    def close(self) -> None:
        """Stop drawing; a second call does nothing."""
        self._bar.stop()

    def __enter__(self) -> Self:
        """Begin to draw."""
        self._bar.start()
        return self


@final
class RunProgress(PhaseProgress):
    """Components while "building", seconds while "simulating"."""

    def words(self, phase: str, done: float, total: float, elapsed: float) -> tuple[str, str]:
        """Count what is built; then simulated time, and how fast it passes."""
        if phase == "building":
            return f"building {total:.0f} components, once:", f"{done:.0f} of {total:.0f}"
        return "simulating", f"{done:.1f} of {total:g} s, {done / elapsed:.0f} times real time"


@final
class StudyProgress(PhaseProgress):
    """Nothing to count while "building", then runs, or whatever is `counted`."""

    def __init__(self, counted: str = "runs") -> None:
        self._counted = counted
        super().__init__()

    def words(self, phase: str, done: float, total: float, elapsed: float) -> tuple[str, str]:
        """Count what is finished."""
        if phase == "building":
            return "building (once)", ""
        return phase, f"{done:.0f} of {total:.0f} {self._counted}"


@final
class FitProgress(PhaseProgress):
    """Iterations of a fit, whose end is not known."""

    def words(self, phase: str, done: float, total: float, elapsed: float) -> tuple[str, str]:
        """Return the phase alone."""
        return phase, ""
