"""Observers see every row once, whatever happens meanwhile."""

from __future__ import annotations

import signal
from typing import Any

import pytest

from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.observer import uninterrupted


class Interrupted:
    """An observer during whose work Ctrl-C is pressed at every fifth row."""

    def __init__(self) -> None:
        self.ticks: list[int] = []

    def begin(self, plan: Any, columns: Any) -> None: ...

    def observe(self, chunk: Any) -> None:
        if len(self.ticks) % 5 == 4:
            signal.raise_signal(signal.SIGINT)
        self.ticks += chunk.ticks.tolist()

    def end(self) -> None: ...


def test_an_interruption_loses_no_row_and_shows_none_twice(wired: Any, native: Any) -> None:
    observer = Interrupted()
    interruptions = 0
    with Master(*wired({"a": native}), observers=[observer]) as master:
        master.initialize()
        while master.tick < 40:
            try:
                master.step()
            except KeyboardInterrupt:
                interruptions += 1
    assert interruptions == 8
    assert observer.ticks == list(range(41))


def test_the_interruption_comes_after_the_block_once() -> None:
    done = []

    def work() -> None:
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            done.append(1)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == [1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
