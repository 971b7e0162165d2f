"""Ctrl-C and SIGTERM as a question that a training asks after each step; a second one ends it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Self, final

__all__ = ["Interruption", "TrainingInterrupted"]


Handler = Callable[[int, FrameType | None], object] | int | None


class TrainingInterrupted(KeyboardInterrupt):
    """A training that was kept, and says how it goes on; `status` is for a command to exit with."""

    def __init__(self, sentence: str, status: int) -> None:
        super().__init__(sentence)
        self.status = status


@final
class Interruption:
    """While it is entered, the first signal is only noted: calling this says whether it came.

    `status` is the exit status of a command that it ended: 130, or 143 after SIGTERM. Threads but
    the main one cannot listen; there nothing is ever noted.
    """

    status = 130
    _before: dict[int, Handler]

    def __enter__(self) -> Self:
        """Begin to listen."""
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
        """Leave signals to whoever had them before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        """Return whether a signal came."""
        return self._came

    def _note(self, number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGTERM:
            self.status = 143
        if self._came:
            raise KeyboardInterrupt
        self._came = True
