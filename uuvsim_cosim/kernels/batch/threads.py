"""Threads that step a batch together and that a signal in the calling thread cannot corrupt.

A signal handler can raise an exception at any instruction of the calling thread. In a
`ThreadPoolExecutor`, this can leave a lock locked, and the next call waits forever. Here the
calling thread holds no lock. It uses only `SimpleQueue`, whose methods are atomic, and flags that
only the workers write.
"""

from __future__ import annotations

import os
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from queue import SimpleQueue
from typing import final

from uuvsim_cosim.closing import Closing

__all__ = ["Range", "Threads"]

Range = tuple[int, int]
Call = Callable[[int, int, int], object]
_POLL = 1e-4  # [s] between two checks of the workers after an interrupted call


@final
class _Job:
    """Work of one call: a free thread takes the next of the remaining `ranges`."""

    def __init__(self, call: Call, ranges: Iterator[Range]) -> None:
        self.call = call
        self.ranges = ranges
        self.results: list[object] = []
        self.errors: list[BaseException] = []

    def work(self, worker: int) -> None:
        for first, last in self.ranges:
            self.results.append(self.call(worker, first, last))

    def abandon(self) -> None:
        """Take the remaining ranges, so that a worker that starts later does nothing."""
        for _ in self.ranges:
            pass


@final
class Threads(Closing):
    """`n - 1` worker threads beside the calling thread.

    If an exception ends `each`, it first waits until all workers are idle. If a second exception
    interrupts this wait, the next call of `each` or `close` waits instead.
    """

    def __init__(self, n: int) -> None:
        self.owner = os.getpid()  # threads do not survive a fork
        self._jobs: SimpleQueue[_Job | None] = SimpleQueue()
        self._finished: SimpleQueue[_Job] = SimpleQueue()
        self._at: list[_Job | None] = [None] * n  # a worker's job; it alone writes
        self._unsettled: _Job | None = None
        self._end = weakref.finalize(self, _end, self._jobs, n - 1)
        for worker in range(1, n):
            threading.Thread(
                target=_serve, args=(worker, self._jobs, self._finished, self._at), daemon=True
            ).start()

    def each(self, call: Call, ranges: Sequence[Range]) -> list[object]:
        """Return what ``call(worker, first, last)`` returns for each range, in any order."""
        self._settle()
        job = self._unsettled = _Job(call, iter(ranges))
        others = len(self._at) - 1 if self._end.alive else 0  # closed: the caller does all
        try:
            for _ in range(others):
                self._jobs.put(job)
            job.work(0)
            while others:
                others -= self._finished.get() is job  # not a job that was interrupted before
        except BaseException:
            self._settle()
            raise
        self._unsettled = None
        if job.errors:
            raise job.errors[0]
        return job.results

    def close(self) -> None:
        """End the threads; a second call does nothing."""
        self._settle()
        self._end()

    def _settle(self) -> None:
        """Wait until no worker works on an interrupted job."""
        job = self._unsettled
        if job is None or self.owner != os.getpid():
            return
        job.abandon()
        # A worker writes its job before it takes a range. So a worker that is idle now finds no
        # range when it starts.
        while any(at is job for at in self._at):
            time.sleep(_POLL)
        self._unsettled = None


def _serve(
    worker: int,
    jobs: SimpleQueue[_Job | None],
    finished: SimpleQueue[_Job],
    at: list[_Job | None],
) -> None:
    while (job := jobs.get()) is not None:
        at[worker] = job
        try:
            job.work(worker)
        except BaseException as error:
            job.errors.append(error)
            job.abandon()
        at[worker] = None
        finished.put(job)


def _end(jobs: SimpleQueue[_Job | None], workers: int) -> None:
    for _ in range(workers):
        jobs.put(None)
