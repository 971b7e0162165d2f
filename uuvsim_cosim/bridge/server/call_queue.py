"""The queue of calls: they come from any thread, and one thread carries them out in order."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, final

from uuvsim_cosim.errors import InputInvalid

__all__ = ["Answer", "Calls"]

Answer = Future[Any]


# `work(answer)` sets the result of its answer, or keeps the answer for later.
_Call = tuple[Callable[[Answer], None], Answer]


@final
class Calls:
    """The queue; once closed, it refuses calls by InputInvalid."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[_Call] = queue.SimpleQueue()
        self._closed = False
        self._lock = threading.Lock()

    def put(self, work: Callable[[Answer], None]) -> Answer:
        """Put work in the queue; the future has its answer, or the error that it raised."""
        answer: Answer = Future()
        with self._lock:
            if self._closed:
                raise InputInvalid("the co-simulation has ended", "one that is served")
            self._queue.put((work, answer))
        return answer

    def carry_out(self, timeout: float | None) -> bool:
        """Carry out the next call, if one comes within `timeout` s; return whether one came."""
        try:
            if timeout is None:
                work, answer = self._queue.get()
            elif timeout <= 0.0:
                work, answer = self._queue.get_nowait()
            else:
                work, answer = self._queue.get(timeout=timeout)
        except queue.Empty:
            return False
        try:
            work(answer)
        except BaseException as error:  # raised again in the thread that waits for the answer
            if not answer.done():
                answer.set_exception(error)
        return True

    def close(self, work: Callable[[Answer], None]) -> Answer:
        """Put the last work in the queue, and refuse all later calls."""
        answer: Answer = Future()
        with self._lock:
            self._closed = True
            self._queue.put((work, answer))
        return answer

    def drain(self) -> None:
        """Answer the calls that still wait by the error that the co-simulation has ended."""
        while True:
            try:
                _, answer = self._queue.get_nowait()
            except queue.Empty:
                return
            answer.set_exception(InputInvalid("the co-simulation has ended meanwhile"))
