"""Threads of a batch share out ranges, and survive an exception at any instruction."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.kernels.batch.threads import Range, Threads

RANGES = [(i, i + 1) for i in range(8)]


class Interrupted(BaseException):
    """Raised at one instruction, as a signal handler does."""


def counted(threads: Threads, counts: np.ndarray) -> list[Any]:
    def count(worker: int, first: int, last: int) -> Range:
        counts[first:last] += 1
        return first, last

    return threads.each(count, RANGES)


def raising_at(instruction: int) -> Callable[[FrameType, str, Any], Any]:
    """Return a trace function that raises before the n-th instruction of the calling thread."""
    left = [instruction]

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        if event == "opcode":
            left[0] -= 1
            if left[0] == 0:
                sys.settrace(None)
                raise Interrupted
        return trace

    return trace


@pytest.mark.parametrize("n", [2, 3])
def test_each_range_is_worked_on_exactly_once(n: int) -> None:
    with Threads(n) as threads:
        for _ in range(200):
            counts = np.zeros(len(RANGES), int)
            assert sorted(counted(threads, counts)) == RANGES
            assert (counts == 1).all()


def test_after_an_exception_at_any_instruction_the_next_call_works() -> None:
    threads, instruction, interrupted = Threads(3), 0, True
    before = sys.gettrace()
    while interrupted:
        instruction, counts = instruction + 1, np.zeros(len(RANGES), int)
        sys.settrace(raising_at(instruction))
        try:
            counted(threads, counts)
            interrupted = False
        except Interrupted:
            pass
        finally:
            sys.settrace(before)
        assert (counts <= 1).all()
        then = np.zeros(len(RANGES), int)
        assert sorted(counted(threads, then)) == RANGES
        assert (then == 1).all()
    assert instruction > 100  # all instructions were tried
    threads.close()


def test_nothing_is_at_work_after_an_exception_in_the_calling_thread() -> None:
    working: set[int] = set()

    def work(worker: int, first: int, last: int) -> None:
        if worker == 0:
            raise Interrupted
        working.add(worker)
        for _ in range(1000):
            os.getpid()
        working.remove(worker)

    with Threads(3) as threads:
        for _ in range(50):
            with pytest.raises(Interrupted):
                threads.each(work, RANGES)
            assert not working


def test_an_error_in_a_worker_is_raised_in_the_calling_thread() -> None:
    def work(worker: int, first: int, last: int) -> int:
        if first == 5:
            raise ZeroDivisionError(f"range {first}")
        return first

    with Threads(3) as threads:
        for _ in range(20):
            with pytest.raises(ZeroDivisionError, match="range 5"):
                threads.each(work, RANGES)
        assert sorted(counted(threads, np.zeros(8, int))) == RANGES


def test_after_a_second_close_the_calling_thread_does_all_ranges() -> None:
    threads = Threads(3)
    threads.close()
    threads.close()
    workers = threads.each(lambda worker, first, last: worker, RANGES)
    assert workers == [0] * len(RANGES)
