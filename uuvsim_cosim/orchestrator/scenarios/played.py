"""Playback of a scenario: its events are applied between the steps of a master."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, final

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.scenarios.scenario import (
    Change,
    Event,
    Manipulation,
    Scenario,
    SignalFault,
)
from uuvsim_cosim.orchestrator.values.endpoints import Endpoint, resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = ["Played", "SteppedMaster", "events_of"]


class SteppedMaster:
    """Steps of a master with something between them, which subclasses add in `step`."""

    def __init__(self, master: Master) -> None:
        self._master = master

    @property
    def tick(self) -> int:
        """The communication point that has been reached."""
        return self._master.tick

    @property
    def time(self) -> float:
        """Time at the communication point that has been reached [s]."""
        return self._master.time


@final
class Played(SteppedMaster):
    """Steps of a master, with the events of a scenario between them.

    All events are checked when it is made, so that a wrong one is reported before the first step.
    """

    def __init__(self, master: Master, scenario: Scenario) -> None:
        super().__init__(master)
        self._due: dict[int, list[Callable[[], None]]] = {}
        for number, event in enumerate(scenario.events, start=1):
            place = f"scenario {scenario.name!r}, event {number}"
            try:
                for single in events_of(event, master):
                    # Raises InputInvalid for an event that cannot be applied.
                    if isinstance(single, SignalFault):
                        master.faults.clear(master.faults.add(single.fault))
                    else:
                        self._change(single)
                    self._schedule(single)
            except InputInvalid as error:
                raise InputInvalid(f"{place}: {error}") from None
        self._ticks = sorted(self._due, reverse=True)  # the next one is the last
        # A fault begins with the values at the tick after its call.
        master.stop_at(later for tick in self._due for later in (tick, tick + 1))

    def step(self, n: int = 1) -> None:
        """Make n communication steps, and apply the events that are due between them."""
        end = self._master.tick + n
        while self._master.tick < end:
            while self._ticks and self._ticks[-1] <= self._master.tick:
                for apply in self._due.pop(self._ticks.pop()):
                    apply()
            until = min(end, self._ticks[-1]) if self._ticks else end
            self._master.step(until - self._master.tick)

    def _schedule(self, event: Change | SignalFault) -> None:
        """Note the calls of an event, each by the communication point where it is due."""
        if isinstance(event, Change):
            self._at(self._tick(event.at), lambda: self._master.set(*self._change(event)))
            return
        if math.isinf(event.at):
            raise InputInvalid("at inf s", "a finite time")
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

    def _change(self, change: Change) -> tuple[str, str, Any]:
        """Return component, variable and value; elements that are not named keep their value."""
        path, _, name = change.variable.rpartition(".")
        value = change.value
        if name.endswith("]"):
            point = _endpoint(change.variable, self._master.plan)
            name = point.variable.name
            if not point.whole:
                whole = np.array(self._master.get(path, name), object)
                new = value if isinstance(value, list) else [value] * len(point.elements)
                if len(new) != len(point.elements) or any(isinstance(x, str) for x in new):
                    raise InputInvalid(
                        change.variable, repr(value), f"1 or {len(point.elements)} plain numbers"
                    )
                whole.flat[list(point.elements)] = new
                value = whole.tolist()
        return path, name, self._master.fitted(path, name, value)

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


def _endpoint(text: str, plan: Plan) -> Endpoint:
    try:
        return resolve_endpoint(text, {c.path: c.description for c in plan.components})
    except Misfit as misfit:
        raise InputInvalid(str(misfit.at(text))) from None


def events_of(event: Event, master: Master) -> Sequence[Change | SignalFault]:
    """Return the event, or the events that a manipulation of a variable means in this system.

    An output gets a fault. A parameter or an unconnected input gets a change (a bias adds to its
    present value), and at `until` its present value again. For a connected input, the output that
    feeds it gets a fault, if it feeds no other input. Raises InputInvalid in all other cases.
    """
    if not isinstance(event, Manipulation):
        return (event,)
    point = _endpoint(event.variable, master.plan)
    if point.variable.causality == "output":
        return (_fault(event, event.variable, event.value),)
    fed = [_feeding(event, master, point, e) for e in point.elements]
    if all(source is not None for source in fed) and fed:
        return [_fault(event, *source) for source in fed if source is not None]
    if any(fed):
        raise InputInvalid(event.variable, "some of its elements are connected", "one element")
    return _changes(event, master, point)


def _fault(event: Manipulation, signal: str, value: float) -> SignalFault:
    return SignalFault(event.at, Fault(signal, event.kind, value), event.until)


def _feeding(
    event: Manipulation, master: Master, point: Endpoint, element: int
) -> tuple[str, float] | None:
    """Return the output that feeds an element, and its value for the event; None if unconnected."""
    components = master.plan.components
    pairs = [
        (t, s, e)
        for t in master.plan.transfers
        for s, e in zip(t.source_elements, t.target_elements, strict=True)
    ]
    for transfer, s, e in pairs:
        target = (components[transfer.target].path, transfer.target_variable.name, e)
        if target != (point.element, point.variable.name, element):
            continue
        source = (transfer.source, transfer.source_variable.name, s)
        others = [
            f"{components[t.target].path}.{t.target_variable.element_name(i)}"
            for t, other, i in pairs
            if (t.source, t.source_variable.name, other) == source
            and (components[t.target].path, t.target_variable.name, i) != target
        ]
        signal = f"{components[transfer.source].path}.{transfer.source_variable.element_name(s)}"
        if transfer.table:
            raise InputInvalid(
                event.variable,
                "is connected through a table of values",
                f"the output connected to it, {signal}",
            )
        if others:
            raise InputInvalid(
                event.variable,
                f"is connected to {signal}, which is connected to {', '.join(others)} as well",
                f"an unconnected input, or {signal} itself, which changes all inputs connected to "
                "it",
            )
        offset = transfer.offset if event.kind == "override" else 0.0
        return signal, (event.value - offset) / transfer.factor
    return None


def _changes(event: Manipulation, master: Master, point: Endpoint) -> Sequence[Change]:
    """Return the changes of a parameter or an unconnected input; raises InputInvalid."""
    name = f"{point.element}.{point.variable.name}"
    begin = np.array(master.get(point.element, point.variable.name))
    if event.kind == "bias" and begin.dtype.kind not in "fiu":
        raise InputInvalid(
            event.variable, f"a bias of a {point.variable.type}", "an override, or numbers"
        )
    value = begin.astype(object)
    for element in point.elements:
        new = event.value + (begin.flat[element].item() if event.kind == "bias" else 0)
        # JSON has only floats: a whole number for an integer variable, 0 or 1 for a Boolean.
        # `Master.fitted` refuses any other value for such a variable.
        if begin.dtype.kind == "b" and new in (0.0, 1.0):
            new = bool(new)
        elif begin.dtype.kind in "iu" and new.is_integer():
            new = int(new)
        value.flat[element] = new
    changes = [Change(event.at, name, value.tolist())]
    if not math.isinf(event.until):
        changes.append(Change(event.until, name, begin.tolist()))
    return changes
