"""Work shared among threads: each thread takes the next piece when it is free.

As in `uuvsim_cosim.kernels.batch.threads`, the calling thread uses nothing that a signal handler,
which may raise at any instruction, could leave locked: no executor, no `Event`, no `Condition`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from queue import Empty, SimpleQueue
from typing import TypeVar

__all__ = ["compute_in_threads", "share"]

W = TypeVar("W")
P = TypeVar("P")
R = TypeVar("R")


def share(
    work: Callable[[W, P], R], workers: Sequence[W], pieces: Sequence[P], *, wait: bool = False
) -> Iterator[R]:
    """Yield the results of ``work(worker, piece)`` as they come; the first error ends the work.

    A single worker works in the calling thread. After an error or an interruption, pieces that have
    begun go on in their threads; `wait` waits for them. Closing what the workers hold is up to the
    caller.
    """
    if len(workers) == 1:
        for piece in pieces:
            yield work(workers[0], piece)
        return
    waiting: SimpleQueue[P] = SimpleQueue()
    for piece in pieces:
        waiting.put(piece)
    results: SimpleQueue[R | BaseException] = SimpleQueue()
    ended: list[bool] = []

    def go_on(worker: W) -> None:
        while not ended:
            try:
                piece = waiting.get_nowait()
            except Empty:
                return
            try:
                results.put(work(worker, piece))
            except BaseException as error:
                results.put(error)
                return

    threads = [threading.Thread(target=go_on, args=(w,), daemon=True) for w in workers]
    try:
        for thread in threads:
            thread.start()
        for _ in pieces:
            result = results.get()
            if isinstance(result, BaseException):
                raise result
            yield result
    finally:
        ended.append(True)
        if wait:
            for thread in threads:
                if thread.ident is not None:
                    thread.join()


def compute_in_threads(
    work: Callable[[P], R], pieces: Sequence[P], threads: int
) -> Iterator[tuple[P, R]]:
    """Yield each piece with the result of ``work(piece)`` as it comes, computed in `threads`.

    No thread is at work after the first error or an interruption.
    """
    numbers = range(max(1, min(threads, len(pieces))))
    yield from share(lambda _, piece: (piece, work(piece)), numbers, pieces, wait=True)
