"""Work is shared: each worker takes the next piece when it has done one."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

__all__ = ["share"]

W = TypeVar("W")
P = TypeVar("P")
R = TypeVar("R")


def share(work: Callable[[W, P], R], workers: Sequence[W], pieces: Sequence[P]) -> Iterator[R]:
    """Give what `work(worker, piece)` gives, as it comes; the first error ends all.

    One worker works in the calling thread. Closing what several wait for is up to the caller.
    """
    if len(workers) == 1:
        for piece in pieces:
            yield work(workers[0], piece)
        return
    waiting: queue.SimpleQueue[P] = queue.SimpleQueue()
    for piece in pieces:
        waiting.put(piece)
    results: queue.SimpleQueue[R | BaseException] = queue.SimpleQueue()
    ended = threading.Event()

    def go_on(worker: W) -> None:
        while not ended.is_set():
            try:
                piece = waiting.get_nowait()
            except queue.Empty:
                return
            try:
                results.put(work(worker, piece))
            except BaseException as error:
                results.put(error)
                return

    threads = [threading.Thread(target=go_on, args=(w,), daemon=True) for w in workers]
    for thread in threads:
        thread.start()
    try:
        for _ in pieces:
            result = results.get()
            if isinstance(result, BaseException):
                raise result
            yield result
    finally:
        ended.set()
