"""Real time, with a clock of the test's own: nothing here waits."""

from __future__ import annotations

import pytest

from uuvsim_cosim.errors import InputInvalid, Overrun
from uuvsim_cosim.orchestrator.master.real_time import Pace


class Clock:
    """Time that passes by sleeping, by looking (1 µs) and by stepping."""

    def __init__(self) -> None:
        self.now = 100.0
        self.slept = 0.0

    def __call__(self) -> float:
        self.now += 1e-6
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now += seconds
        self.slept += seconds


class Steps:
    """Steps of 10 ms that cost what `cost` says."""

    def __init__(self, clock: Clock, cost: dict[int, float] | None = None) -> None:
        self.clock, self.cost = clock, cost or {}
        self.tick = 0
        self.began: list[float] = []
        self.calls: list[int] = []

    @property
    def time(self) -> float:
        return self.tick * 0.01

    def step(self, n: int = 1) -> None:
        self.began.append(self.clock.now)
        self.clock.now += sum(self.cost.get(self.tick + i, 1e-4) for i in range(n))
        self.tick += n
        self.calls.append(n)


def paced(factor: float, policy: str, cost: dict[int, float] | None = None, n: int = 20):  # type: ignore[no-untyped-def]
    clock = Clock()
    steps, pace = (
        Steps(clock, cost),
        Pace(factor, policy, clock=clock, sleep=clock.sleep),  # type: ignore[arg-type]
    )
    pace.advance(steps, n, 0.01)
    return clock, steps, pace


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_steps_begin_when_real_time_has_come_to_them(factor: float) -> None:
    _, steps, pace = paced(factor, "catch-up")
    due = [100.0 + k * 0.01 / factor for k in range(20)]
    assert steps.began == pytest.approx(due, abs=1e-5)
    assert pace.punctuality().worst < 1e-5
    assert pace.punctuality().overruns == 0


def test_after_an_overrun_catching_up_holds_the_schedule_again() -> None:
    _, steps, pace = paced(1.0, "catch-up", {5: 0.035})
    assert steps.began[6:9] == pytest.approx([100.085, 100.0851, 100.0852], abs=1e-4)
    assert steps.began[10] == pytest.approx(100.1, abs=1e-5)
    assert pace.punctuality().overruns == 3
    assert pace.punctuality().slipped == 0.0


def test_after_an_overrun_slipping_moves_the_schedule() -> None:
    _, steps, pace = paced(1.0, "slip", {5: 0.035})
    assert steps.began[6] == pytest.approx(100.085, abs=1e-5)
    assert steps.began[7] == pytest.approx(100.095, abs=1e-5)
    assert pace.punctuality().overruns == 1
    assert pace.punctuality().slipped == pytest.approx(0.025, abs=1e-5)


def test_an_overrun_that_must_not_be_names_the_time_and_how_late() -> None:
    with pytest.raises(Overrun, match=r"t = 0\.06 s was reached 25 ms late.*a smaller factor"):
        paced(1.0, "fail", {5: 0.035})


def test_ticks_shorter_than_a_millisecond_are_stepped_several_at_a_time() -> None:
    _, steps, _ = paced(100.0, "catch-up", dict.fromkeys(range(40), 1e-6), 40)
    assert steps.calls == [10, 10, 10, 10]


def test_the_rolling_factor_is_that_of_the_last_second() -> None:
    clock = Clock()
    pace = Pace(2.0, clock=clock, sleep=clock.sleep)
    steps = Steps(clock)
    pace.advance(steps, 400, 0.01)
    assert pace.rolling_factor == pytest.approx(2.0, rel=0.02)
    slow = Pace(1.0, clock=clock, sleep=clock.sleep)
    steps.cost = dict.fromkeys(range(1000), 0.02)
    slow.advance(steps, 600, 0.01)
    assert slow.rolling_factor == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_a_factor_that_is_none_is_refused(factor: float) -> None:
    with pytest.raises(InputInvalid, match="expected more than 0"):
        Pace(factor)


def test_an_unknown_policy_is_refused_with_those_there_are() -> None:
    with pytest.raises(InputInvalid, match="catch-up, slip, fail"):
        Pace(1.0, "wait")  # type: ignore[arg-type]
