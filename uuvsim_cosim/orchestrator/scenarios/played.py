"""Playback of a scenario: its events happen between the steps of a master."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, final

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.scenarios.manipulation import meant
from uuvsim_cosim.orchestrator.scenarios.scenario import (
    Change,
    Event,
    Manipulation,
    Scenario,
    SignalFault,
)

__all__ = ["Played"]


@final
class Played:
    """A master whose steps have the events of a scenario between them."""

    def __init__(self, master: Master, scenario: Scenario) -> None:
        self._master = master
        self._due: dict[int, list[Callable[[], None]]] = {}
        for number, event in enumerate(scenario.events, start=1):
            place = f"scenario {scenario.name!r}, event {number}"
            try:
                for single in self._meant(event):
                    self._check(single)
                    self._plan(single)
            except InputInvalid as error:
                raise InputInvalid(f"{place}: {error}") from None

    @property
    def tick(self) -> int:
        """The communication point that has been reached."""
        return self._master.tick

    @property
    def time(self) -> float:
        """Time at the communication point that has been reached [s]."""
        return self._master.time

    def step(self, n: int = 1) -> None:
        """Make n communication steps, with what happens between them."""
        end = self._master.tick + n
        while self._master.tick < end:
            for happen in self._due.pop(self._master.tick, ()):
                happen()
            later = [tick for tick in self._due if self._master.tick < tick < end]
            self._master.step(min([end, *later]) - self._master.tick)

    def _meant(self, event: Event) -> Sequence[Change | SignalFault]:
        if not isinstance(event, Manipulation):
            return (event,)
        return meant(event, self._master)

    def _plan(self, event: Change | SignalFault) -> None:
        if isinstance(event, Change):
            self._at(self._tick(event.at), lambda: self._set(event.variable, event.value))
            return
        if math.isinf(event.at):
            raise InputInvalid("at inf s; expected a time that comes")
        first, last = self._tick(event.at), self._tick(event.until)
        if last is not None and first is not None and last <= first:
            raise InputInvalid(
                f"until {event.until:g} s is not after at {event.at:g} s; expected a later time"
            )
        numbers: list[int] = []
        faults = self._master.faults
        # What is seen at a communication point is read at the end of the step before it.
        self._at(_before(first), lambda: numbers.append(faults.add(event.fault)))
        self._at(_before(last), lambda: faults.clear(numbers.pop()))

    def _at(self, tick: int | None, happen: Callable[[], None]) -> None:
        if tick is not None and tick >= self._master.tick:
            self._due.setdefault(tick, []).append(happen)

    def _tick(self, time: float) -> int | None:
        """Return the first communication point at or after a time; None for never."""
        if math.isnan(time) or time < 0.0:
            raise InputInvalid(f"at {time:g} s; expected seconds, 0 or more")
        if math.isinf(time):
            return None
        return math.ceil(Fraction(str(time)) / self._master.plan.tick)

    def _check(self, event: Change | SignalFault) -> None:
        """Try an event out before anything runs: what is wrong with it is told at once."""
        if isinstance(event, SignalFault):
            self._master.faults.clear(self._master.faults.add(event.fault))
        else:
            path, name = _split(event.variable)
            self._master.fitted(path, name, event.value)

    def _set(self, variable: str, value: Any) -> None:
        path, name = _split(variable)
        self._master.set(path, name, self._master.fitted(path, name, value))


def _before(tick: int | None) -> int | None:
    return None if tick is None else max(0, tick - 1)


def _split(variable: str) -> tuple[str, str]:
    path, _, name = variable.rpartition(".")
    return path, name
