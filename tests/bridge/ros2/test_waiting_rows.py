"""Rows that wait for the thread that publishes: views, and copies before memory is used again."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from uuvsim_cosim.bridge.ros2.waiting_rows import WaitingRows
from uuvsim_cosim.orchestrator.master.observer import Chunk, Rows


class Memory:
    """Memory of a master for some rows, in which row k of a run has the value k."""

    def __init__(self, rows: int, columns: int = 1) -> None:
        self.ticks, self.slots = np.zeros(rows, np.int64), np.zeros((rows, columns))
        self.used = self.next = 0

    def chunk(self, n: int) -> Chunk:
        """Write n rows, and return them; the memory is used again once it is full."""
        begin, self.used = self.used, self.used + n
        written = np.arange(self.next, self.next + n)
        self.ticks[begin : self.used] = written
        self.slots[begin : self.used] = written[:, None]
        self.next += n
        full = self.used == len(self.ticks)
        held = Rows(self.ticks[: self.used], self.slots[: self.used], full)
        if full:
            self.used = 0
        return Chunk((), Fraction(1), held.ticks[begin:], held.slots[begin:], (), held)


def test_rows_are_given_once_and_in_order() -> None:
    rows, memory = WaitingRows[str](), Memory(100)
    rows.add("run", memory.chunk(2))
    rows.add("run", memory.chunk(1))
    assert [part.slots[:, 0].tolist() for part in rows.take()] == [[0, 1, 2]]
    rows.add("run", memory.chunk(1))
    assert [part.slots[:, 0].tolist() for part in rows.take()] == [[3]]
    assert rows.take() == []


def test_rows_that_wait_outlive_the_memory() -> None:
    rows, memory = WaitingRows[str](), Memory(4)
    rows.add("run", memory.chunk(4))
    rows.add("run", memory.chunk(3))  # over the first ones
    assert [part.slots[:, 0].tolist() for part in rows.take()] == [[0, 1, 2, 3], [4, 5, 6]]
    assert rows.dropped == 0


def test_a_reader_sees_that_its_rows_are_overwritten() -> None:
    rows, memory = WaitingRows[str](), Memory(4)
    rows.add("run", memory.chunk(3))
    [part] = rows.take()
    assert rows.is_intact(part)
    rows.add("run", memory.chunk(1))
    assert rows.is_intact(part)  # the memory is full, and nothing is overwritten yet
    rows.add("run", memory.chunk(1))
    assert not rows.is_intact(part)


def test_wide_rows_are_copied_up_to_a_number_of_bytes() -> None:
    rows, memory = WaitingRows[str](), Memory(16, columns=200_000)  # 1.6 MB a row
    rows.add("run", memory.chunk(16))
    [part] = rows.take()
    assert part.ticks.tolist() == [11, 12, 13, 14, 15]
    assert part.slots.nbytes <= 8 << 20
    assert rows.dropped == 11


def test_rows_of_the_run_before_are_given_as_its_own() -> None:
    rows = WaitingRows[str]()
    rows.add("first", Memory(9).chunk(2))
    rows.add("second", Memory(9).chunk(1))
    assert [(part.run, len(part.ticks)) for part in rows.take()] == [("first", 2), ("second", 1)]
