"""Playback of a scenario: its events are applied between the steps of a master."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import final

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.scenarios.manipulation import events_of
from uuvsim_cosim.orchestrator.scenarios.scenario import (
    Change,
    Scenario,
    SignalFault,
)

__all__ = ["Played"]


@final
class Played:
    """Steps of a master, with the events of a scenario between them.

    All events are checked when it is made, so that a wrong one is reported before the first step.
    """

    def __init__(self, master: Master, scenario: Scenario) -> None:
        self._master = master
        self._due: dict[int, list[Callable[[], None]]] = {}
        for number, event in enumerate(scenario.events, start=1):
            place = f"scenario {scenario.name!r}, event {number}"
            try:
                for single in events_of(event, master):
                    # Raises InputInvalid for an event that cannot be applied.
                    if isinstance(single, SignalFault):
                        master.faults.clear(master.faults.add(single.fault))
                    else:
                        master.fitted(*_split(single.variable), single.value)
                    self._schedule(single)
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
        """Make n communication steps, and apply the events that are due between them."""
        end = self._master.tick + n
        while self._master.tick < end:
            for apply in self._due.pop(self._master.tick, ()):
                apply()
            later = [tick for tick in self._due if self._master.tick < tick < end]
            self._master.step(min([end, *later]) - self._master.tick)

    def _schedule(self, event: Change | SignalFault) -> None:
        """Note the calls of an event, each by the communication point where it is due."""
        if isinstance(event, Change):
            path, name = _split(event.variable)
            master, value = self._master, event.value
            self._at(
                self._tick(event.at),
                lambda: master.set(path, name, master.fitted(path, name, value)),
            )
            return
        if math.isinf(event.at):
            raise InputInvalid("at inf s", "a time that comes")
        first, last = self._tick(event.at), self._tick(event.until)
        if last is not None and first is not None and last <= first:
            raise InputInvalid(
                f"until {event.until:g} s is not after at {event.at:g} s", "a later time"
            )
        numbers: list[int] = []
        faults = self._master.faults
        # Signals of a communication point are transferred at the end of the step before it.
        self._at(_before(first), lambda: numbers.append(faults.add(event.fault)))
        self._at(_before(last), lambda: faults.clear(numbers.pop()))

    def _at(self, tick: int | None, call: Callable[[], None]) -> None:
        if tick is not None and tick >= self._master.tick:
            self._due.setdefault(tick, []).append(call)

    def _tick(self, time: float) -> int | None:
        """Return the first communication point at or after a time; None for never."""
        if math.isnan(time) or time < 0.0:
            raise InputInvalid(f"at {time:g} s", "seconds, 0 or more")
        if math.isinf(time):
            return None
        return math.ceil(Fraction(str(time)) / self._master.plan.tick)


def _before(tick: int | None) -> int | None:
    return None if tick is None else max(0, tick - 1)


def _split(variable: str) -> tuple[str, str]:
    path, _, name = variable.rpartition(".")
    return path, name
