"""Pacing of communication steps by the wall clock, and statistics of late steps."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Literal, Protocol, final, get_args

import numpy as np

from uuvsim_cosim.errors import InputInvalid, Overrun

__all__ = ["Overruns", "Pace", "Punctuality", "Steps"]

Overruns = Literal["catch-up", "slip", "fail"]
_ROLLING = 1.0  # [s] of wall time over which the rolling factor is computed
_WAKES = 1000.0  # [1/s] at most: shorter ticks are stepped several at a time
_SPIN = 2e-4  # [s] of active waiting before an instant, because sleeping is not more exact


class Steps(Protocol):
    """Object that makes communication steps: a master, or one with a scenario or inputs."""

    @property
    def tick(self) -> int:
        """The communication point that has been reached."""

    @property
    def time(self) -> float:
        """Time there [s]."""

    def step(self, n: int = 1) -> None:
        """Make n communication steps."""


@dataclass(frozen=True)
class Punctuality:
    """Timing of a run in real time: lateness of its steps' beginnings [s], and overruns.

    An overrun is a step that ended after the next one should have begun.
    """

    factor: float
    steps: int
    median: float
    p99: float
    worst: float
    overruns: int
    slipped: float  # [s] of wall time that the schedule was moved by


@final
class Pace:
    """Stepping at `factor` times real time.

    After an overrun, "catch-up" makes steps without waiting until they are in time again, "slip"
    delays the schedule, "fail" raises Overrun.
    """

    def __init__(
        self,
        factor: float = 1.0,
        overruns: Overruns = "catch-up",
        *,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not 0.0 < factor < float("inf"):
            raise InputInvalid("real time", f"factor {factor:g}", "more than 0")
        if overruns not in get_args(Overruns):
            known = ", ".join(get_args(Overruns))
            raise InputInvalid("overruns", f"{overruns!r}", f"one of {known}")
        self.factor = factor
        self._policy = overruns
        self._clock, self._sleep = clock, sleep
        self._late: list[float] = []
        self._overruns = 0
        self._slipped = 0.0
        self._recent: deque[tuple[float, float]] = deque()

    def advance(
        self,
        master: Steps,
        steps: int,
        tick: float,
        report: Callable[[float], None] = lambda time: None,
    ) -> None:
        """Step up to communication point `steps`; `tick` [s]; `report(time)` after each wake."""
        period = tick / self.factor
        each = max(1, ceil(1.0 / (_WAKES * period)))
        first = master.tick
        begin = self._clock()
        while master.tick < steps:
            due = begin + (master.tick - first) * period
            remaining = due - self._clock()
            if remaining > _SPIN:
                self._sleep(remaining - _SPIN)
            while self._clock() < due:
                pass
            late = self._clock() - due
            self._late.append(late)
            master.step(min(each, steps - master.tick))
            now = self._clock()
            behind = now - (begin + (master.tick - first) * period)
            if behind > 0.0:
                self._overruns += 1
                if self._policy == "fail":
                    raise Overrun(
                        f"overrun: t = {master.time:.9g} s was reached {1e3 * behind:.3g} ms late "
                        f"at {self.factor:g} times real time; expected a smaller factor, a longer "
                        "step, or another policy than 'fail'"
                    )
                if self._policy == "slip":
                    begin += behind
                    self._slipped += behind
            self._recent.append((now, master.time))
            while len(self._recent) > 2 and self._recent[1][0] < now - _ROLLING:
                self._recent.popleft()
            report(master.time)

    @property
    def rolling_factor(self) -> float:
        """Return simulated over wall time in the last second."""
        if len(self._recent) < 2:
            return 0.0
        (wall, simulated), (now, reached) = self._recent[0], self._recent[-1]
        return (reached - simulated) / (now - wall) if now > wall else 0.0

    def punctuality(self) -> Punctuality:
        """Return the timing statistics of the steps so far."""
        late = np.maximum(self._late, 0.0) if self._late else np.zeros(1)
        median, p99 = np.quantile(late, [0.5, 0.99])
        return Punctuality(
            self.factor, len(self._late), float(median), float(p99), float(late.max()),
            self._overruns, self._slipped,
        )  # fmt: skip
