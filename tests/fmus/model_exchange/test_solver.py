"""The integration between events: also of an FMU that has no states."""

from __future__ import annotations

import ctypes
from typing import Any

import pytest

from uuvsim_cosim.fmus.model_exchange.solver import Solver


class Clockwork:
    """The calls of an instance without states, whose one indicator is 0.3 s - time."""

    states = 0

    def __init__(self, indicators: int) -> None:
        self.indicators, self.time = indicators, 0.0

    def set_time(self, time: float) -> None:
        self.time = time

    def get_indicators(self, pointer: int, n: int) -> None:
        if n:
            (ctypes.c_double * n).from_address(pointer)[0] = 0.3 - self.time


def test_without_states_time_goes_to_the_first_event() -> None:
    calls: Any = Clockwork(1)
    solver = Solver(calls, 1e-6)
    assert solver.integrate(0.0, 0.25) == (0.25, False)
    reached, crossed = solver.integrate(0.25, 1.0)
    assert (reached, crossed) == (pytest.approx(0.3, abs=1e-12), True)
    assert calls.time == reached


def test_without_states_and_indicators_time_goes_to_the_end() -> None:
    calls: Any = Clockwork(0)
    assert Solver(calls, 1e-6).integrate(0.0, 1.0) == (1.0, False)
