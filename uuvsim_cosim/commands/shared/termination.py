"""SIGTERM as an interruption like Ctrl-C: finished runs are kept, and a message is printed."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Self, final

from uuvsim_cosim.closing import Closing

__all__ = ["Termination"]


@final
class Termination(Closing):
    """While it is entered, SIGTERM raises KeyboardInterrupt; a second one ends the process.

    `status` is the exit status of an interrupted command: 130, or 143 after SIGTERM.
    """

    status = 130
    _before: Callable[[int, FrameType | None], object] | int | None = None

    def __enter__(self) -> Self:
        """Install the handler; only the main thread can."""
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGTERM, self._end)
        return self

    def close(self) -> None:
        """Restore the handler of before."""
        if self._before is not None:
            signal.signal(signal.SIGTERM, self._before)

    def _end(self, _number: int, _frame: FrameType | None) -> None:
        self.status = 143
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        raise KeyboardInterrupt
