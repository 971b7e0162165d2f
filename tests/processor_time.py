"""Time limits of tests in processor time, so that a busy machine fails no test.

A test fails if it and the processes that it started use more than `LIMIT` seconds of processor
time, or if they use almost none for `IDLE` seconds: then it waits for an event that never comes.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

import pytest

LIMIT = 300.0  # [s] of processor time
IDLE = 180.0  # [s] with less than `BUSY` of a processor
BUSY = 0.02
GRACE = 5.0  # [s] from the exception to the end of children, and then of the process


def processor_time() -> float:
    """Return the processor time of this process and its descendants, dead or alive [s]."""
    return sum(os.times()[:4]) + sum(map(_processor_time_of, _children(os.getpid())))


def _processor_time_of(process: int) -> float:
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8", errors="replace") as file:
            fields = file.read().rpartition(")")[2].split()
    except OSError:  # it has just ended
        return 0.0
    own = sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")
    return own + sum(map(_processor_time_of, _children(process)))


def _children(process: int) -> list[int]:
    found: list[int] = []
    try:
        for thread in os.listdir(f"/proc/{process}/task"):
            with open(f"/proc/{process}/task/{thread}/children", encoding="ascii") as file:
                found += map(int, file.read().split())
    except OSError:
        pass
    return found


class Watch:
    """A thread that fails the current test in the main thread, or ends the process if it cannot."""

    def __init__(self, limit: float = LIMIT, idle: float = IDLE, grace: float = GRACE) -> None:
        self.limit, self.idle, self.grace = limit, idle, grace
        self._test: str | None = None
        self._reason = ""
        main = threading.main_thread().ident
        assert main is not None
        self._main = main
        threading.Thread(target=self._watch, name="processor time", daemon=True).start()

    @contextmanager
    def over(self, test: str) -> Iterator[None]:
        """Watch over one test."""
        before: Any = signal.signal(signal.SIGUSR1, self._fail)
        self._test = test
        try:
            yield
        finally:
            self._test = None
            signal.signal(signal.SIGUSR1, before)

    def _fail(self, number: int, frame: FrameType | None) -> NoReturn:
        pytest.fail(f"{self._test}: {self._reason}")

    def _watch(self) -> None:
        period = min(1.0, self.idle / 10)
        test, begin, used, idle = None, 0.0, 0.0, 0.0
        while True:
            time.sleep(period)
            now = processor_time()
            if self._test is not test:
                test, begin, idle = self._test, now, 0.0
            idle = idle + period if now - used < BUSY * period else 0.0
            used = now
            if now - begin > self.limit:
                self._reason = f"it used more than {self.limit:g} s of processor time"
            elif idle > self.idle:
                self._reason = f"it waits: almost no processor time in {self.idle:g} s"
            else:
                continue
            if test is not None and self._test is test:
                signal.pthread_kill(self._main, signal.SIGUSR1)
                time.sleep(self.grace)
                for process in _children(os.getpid()) if self._test is test else []:
                    os.kill(process, signal.SIGKILL)  # the test may wait for it to end
                time.sleep(self.grace)
                if self._test is test:
                    print(f"{test}: {self._reason}", file=sys.__stderr__)
                    faulthandler.dump_traceback(sys.__stderr__)
                    os._exit(70)
