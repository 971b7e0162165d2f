"""Progress of long work in a Jupyter notebook: one bar below the cell, gone when the work ends.

Elsewhere nothing is shown; the commands have bars on the terminal. This uses the display of the
kernel, because rich would need ipywidgets there.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import Any, Literal

__all__ = ["Progress", "in_notebook", "shown"]

Progress = Callable[[str, float, float], None]  # phase, done, total
DELAY = 0.5  # s until a bar appears, so that short work leaves no output
PERIOD = 0.2  # s between two updates
COUNTED = {"building": "components", "simulating": "s", "running": "runs", "training": "steps"}


@contextmanager
def shown(progress: Progress | Literal[False] | None) -> Iterator[Progress | None]:
    """Yield what receives the progress of some work, or None.

    That is `progress` if it is a function. Without it, a bar in a notebook, and nothing elsewhere.
    False: nothing anywhere.
    """
    if progress is not None or not in_notebook():
        yield progress or None
        return
    bar = _Bar(import_module("IPython.display"))
    try:
        yield bar
    finally:
        bar.close()


def in_notebook() -> bool:
    """Return whether this runs in a Jupyter kernel; IPython is not imported for it."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None  # a terminal's IPython has none


class _Bar:
    def __init__(self, display: Any) -> None:
        self._display = display
        self._handle: Any = None
        self._next = time.perf_counter() + DELAY

    def __call__(self, phase: str, done: float, total: float) -> None:
        """Show the progress; a phase of which nothing is done yet has no known end."""
        now = time.perf_counter()
        if now < self._next and not (phase == "building" and self._handle is None):
            return
        self._next = now + PERIOD
        bar, text = "<progress></progress>", escape(phase)
        if done > 0:
            bar = f'<progress value="{done:.6g}" max="{total:.6g}"></progress>'
            text += f": {done:,.6g} of {total:,.6g} {COUNTED.get(phase, '')}"
        content = self._display.HTML(f"{bar} {text.rstrip()}")
        if self._handle is None:
            self._handle = self._display.display(content, display_id=True)
        else:
            self._handle.update(content)

    def close(self) -> None:
        """Remove the bar."""
        if self._handle is not None:
            self._handle.update(self._display.HTML(""))
