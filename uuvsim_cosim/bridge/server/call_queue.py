"""Calls from any thread wait in one queue, and one thread carries them out in order."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, final

from uuvsim_cosim.errors import InputInvalid

__all__ = ["Answer", "Calls"]

Answer = Future[Any]


@dataclass(frozen=True)
class _Call:
    """What is to be done: `work(answer)` answers now, or keeps the answer for later."""

    work: Callable[[Answer], None]
    answer: Answer = field(default_factory=Future)


@final
class Calls:
    """The queue; once closed, it refuses what comes in words."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[_Call] = queue.SimpleQueue()
        self._closed = False
        self._lock = threading.Lock()

    def put(self, work: Callable[[Answer], None]) -> Answer:
        """Ask for work; the future gives its answer, or raises what it raised."""
        call = _Call(work)
        with self._lock:
            if self._closed:
                raise InputInvalid("the co-simulation has ended; expected one that is served")
            self._queue.put(call)
        return call.answer

    def carry_out(self, timeout: float | None) -> bool:
        """Carry out the next call, if one comes within `timeout` s; says whether one did."""
        try:
            if timeout is None:
                call = self._queue.get()
            elif timeout <= 0.0:
                call = self._queue.get_nowait()
            else:
                call = self._queue.get(timeout=timeout)
        except queue.Empty:
            return False
        try:
            call.work(call.answer)
        except BaseException as error:  # raised again where the answer is awaited
            if not call.answer.done():
                call.answer.set_exception(error)
        return True

    def close(self, work: Callable[[Answer], None]) -> Answer:
        """Ask for the last work, and refuse whatever comes after."""
        call = _Call(work)
        with self._lock:
            self._closed = True
            self._queue.put(call)
        return call.answer

    def drain(self) -> None:
        """Answer the calls that wait still that it is over."""
        while True:
            try:
                call = self._queue.get_nowait()
            except queue.Empty:
                return
            call.answer.set_exception(InputInvalid("the co-simulation has ended meanwhile"))
