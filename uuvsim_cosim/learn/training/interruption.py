"""Ctrl-C and SIGTERM as a flag that a training reads after each step.

A second signal ends the training at once.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Self, final

__all__ = ["Interruption", "TrainingInterrupted"]


Handler = Callable[[int, FrameType | None], object] | int | None


class TrainingInterrupted(KeyboardInterrupt):
    """Interrupted training that was saved; the message states how to resume it.

    `status` is the exit status of the command.
    """

    def __init__(self, sentence: str, status: int) -> None:
        super().__init__(sentence)
        self.status = status


@final
class Interruption:
    """Context in which the first signal only sets a flag; a call returns the flag.

    `status` is the exit status of an interrupted command: 130, or 143 after SIGTERM. Python
    delivers signals to the main thread only. In other threads, the flag is never set.
    """

    status = 130
    _before: dict[int, Handler]

    def __enter__(self) -> Self:
        """Install the signal handlers."""
        self._came, self._before = False, {}
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Restore the former signal handlers."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        """Return whether a signal has arrived."""
        return self._came

    def _note(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGTERM:
            self.status = 143
        if self._came:
            raise KeyboardInterrupt
        self._came = True
