"""The progress of a training on the terminal: steps, curves of returns, the last evaluation."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Self, final

from rich.console import Group
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.commands.shared.terminal import console

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.training import Progress as TrainingStep

__all__ = ["TrainingProgress", "curve"]

BLOCKS = "▁▂▃▄▅▆▇█"
WIDTH = 60
SHOWN = ("return", "track", "dist", "viol", "clean", "success", "position_error", "heading_error")


@final
class TrainingProgress(Closing):
    """A TrainingObserver; nothing is drawn unless stderr is a terminal."""

    def __init__(self) -> None:
        target = console(stderr=True)
        self._drawn = target.is_terminal
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[shown]}"),
            TimeRemainingColumn(), console=target,
        )  # fmt: skip
        self._task = self._bar.add_task("training", total=1.0, shown="")
        self._live = Live(console=target, transient=True, refresh_per_second=4, auto_refresh=True)
        self._returns: deque[float] = deque(maxlen=4096)
        self._evaluations: list[float] = []
        self._row: dict[str, float] = {}

    def __enter__(self) -> Self:
        """Begin to draw."""
        if self._drawn:
            self._live.start()
            self.say("building (once)")
        return self

    def __call__(self, progress: TrainingStep) -> None:
        """Draw an event of the training."""
        if progress.what == "episodes":
            self._returns.append(progress.row["return"])
        elif progress.what == "evaluation":
            self._evaluations.append(progress.row["return"])
            self._row = {k: progress.row[k] for k in SHOWN if k in progress.row}
        if not self._drawn:
            return
        shown = f"{progress.step:,} of {progress.steps:,} steps, {progress.episodes:,} episodes"
        self._bar.update(
            self._task, description="training", completed=progress.step, total=progress.steps,
            shown=shown,
        )  # fmt: skip
        if progress.what != "step":
            self._draw()

    def say(self, words: str) -> None:
        """Show a stage whose end is not known."""
        self._bar.update(self._task, description=words, total=None, shown="")
        self._draw()

    def close(self) -> None:
        """Stop drawing; a second call does nothing."""
        self._live.stop()

    def _draw(self) -> None:
        grid = Table.grid(padding=(0, 2))
        for name, values in (("episodes", list(self._returns)), ("evaluations", self._evaluations)):
            if values:
                bounds = f"{min(values):.4g} … {max(values):.4g}, now {values[-1]:.4g}"
                grid.add_row(f"return, {name}", Text(curve(values)), bounds)
        numbers = "  ".join(f"{k} {v:.4g}" for k, v in self._row.items())
        self._live.update(Group(self._bar, grid, Text(numbers, style="dim")))


def curve(values: list[float], width: int = WIDTH) -> str:
    """Draw values as blocks of eight heights, at most `width` of them: means of neighbours."""
    finite = [v for v in values if math.isfinite(v)]
    if not finite:
        return ""
    size = max(1, -(-len(finite) // width))
    groups = [finite[i : i + size] for i in range(0, len(finite), size)]
    means = [sum(g) / len(g) for g in groups]
    low, span = min(means), max(means) - min(means)
    heights = (round((m - low) / span * (len(BLOCKS) - 1)) if span > 0 else 0 for m in means)
    return "".join(BLOCKS[h] for h in heights)
