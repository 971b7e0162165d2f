"""A Scheduled Execution FMU as a component: its clocks tick here, and activate its partitions.

A step activates each model partition whose clock ticks from the step's start until before its
end. A tick at a communication point therefore belongs to the step that starts there. Partitions
run one after the other in one thread, so that none is ever preempted.
"""

from __future__ import annotations

import ctypes
import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import final

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.component import Binding, BindingKind, Component
from uuvsim_cosim.fmus.description import ClockTiming, Variable
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.fmu_binary import FmuState, Phase
from uuvsim_cosim.fmus.importer.versions import AnyFmu
from uuvsim_cosim.fmus.model_exchange.component import ModelExchange

__all__ = ["ScheduledExecution", "component_of"]

_TICKS = 10_000  # in one communication step, before they count as endless
_NEAR = Fraction(
    1, 10**9
)  # of the step: a tick that is this near to its end belongs to the next one
_NOT_YET_KNOWN, _CHANGED = 0, 2  # fmi3IntervalQualifier


@dataclass(frozen=True)
class _InputClock:
    """An input clock, which activates one model partition."""

    name: str
    reference: int
    timing: ClockTiming


@dataclass(frozen=True)
class _Schedule:
    """The state of the clocks; `State` is this with the state of the FMU.

    `next` [s] and `interval` [s] are exact and by clock name, where they are known. `ticked` are
    the clocks that ticked in the last step, and `triggers` the triggered input clocks that are on.
    """

    start: Fraction  # [s] the start time
    next: Mapping[str, Fraction]
    interval: Mapping[str, Fraction]
    last: Mapping[str, Fraction]  # [s] the last tick
    ticked: frozenset[str]
    triggers: frozenset[str]


_State = tuple[FmuState, _Schedule]
_NOTHING = _Schedule(Fraction(0), {}, {}, {}, frozenset(), frozenset())


def component_of(fmu: AnyFmu) -> Component:
    """Return an instance as the component of its interface type."""
    if fmu.archive.interface == "ModelExchange":
        return ModelExchange(fmu)
    if isinstance(fmu, Fmu3) and fmu.archive.interface == "ScheduledExecution":
        return ScheduledExecution(fmu)
    return fmu


@final
class ScheduledExecution:
    """The `Component` protocol over an FMU whose importer decides when its partitions run.

    Clocks are Boolean variables of its description: a triggered input clock is an input, which
    ticks at the start of each step in which it is true. All other clocks are outputs, which are
    true if they ticked in the last step.
    """

    def __init__(self, fmu: Fmu3) -> None:
        self.path = fmu.path
        self.description = fmu.description
        self.messages = fmu.messages
        self._fmu = fmu
        clocks = fmu.archive.clocks.values()
        inputs = [
            _InputClock(v.name, v.value_references[0], v.timing)
            for v in clocks
            if v.causality == "input" and v.timing is not None
        ]
        inputs.sort(key=lambda c: c.timing.priority)  # of one instant, the smallest is first
        self._clocks = {c.name: c for c in inputs}
        self._outputs = {v.name: v.value_references[0] for v in clocks if v.causality == "output"}
        self._schedule = _NOTHING
        self._now = Fraction(0)  # [s] of the partition that is active
        self._failure: BaseException | None = None  # of the callback, which cannot raise
        self._ask_again = False  # a parameter that may change intervals was set
        fmu.on_clock_update = self._clock_update
        self.directional_derivative = fmu.directional_derivative
        self.terminate, self.drain_messages = fmu.terminate, fmu.drain_messages

    # ---- values and life cycle ----------------------------------------------------------------

    def get(self, variable: Variable) -> object:
        """Read a value; that of a clock is whether it ticked in the last step, or is on."""
        name = variable.name
        if name in self._outputs or name in self._clocks:
            return name in self._schedule.ticked | self._schedule.triggers
        return self._fmu.get(variable)

    def set(self, variable: Variable, value: object) -> None:
        """Set a value; a triggered clock that is true ticks at the start of each step."""
        if variable.name in self._clocks:
            on = {variable.name} if bool(np.asarray(value)) else set()
            triggers = (self._schedule.triggers - {variable.name}) | on
            self._schedule = replace(self._schedule, triggers=triggers)
            return
        self._fmu.set(variable, value)
        if self._fmu.phase is Phase.STEP and variable.causality == "parameter":
            self._ask_again = True

    def enter_initialization_mode(self, start_time: float, stop_time: float | None) -> None:
        """Begin at `start_time`; the clocks tick from there."""
        start = _exactly(start_time)
        self._schedule = replace(_NOTHING, start=start, triggers=self._schedule.triggers)
        self._fmu.enter_initialization_mode(start_time, stop_time)

    def exit_initialization_mode(self) -> None:
        """Leave Initialization Mode, in which the FMU gives the intervals that it knows."""
        self._now = self._schedule.start
        for clock in self._clocks.values():
            timing = clock.timing
            if timing.is_periodic and timing.interval is not None:
                self._put(clock, timing.interval, self._now + timing.shift)
            elif timing.is_periodic:
                interval = self._interval(clock)
                if interval is None:
                    raise self._wrong(f"clock {clock.name} has no interval")
                self._put(clock, interval, self._now + self._shift(clock))
            elif timing.is_time_based:
                self._count_down(clock)
        self._fmu.exit_initialization_mode()

    def reset(self) -> None:
        """Go back to the state after instantiation."""
        self._schedule = _NOTHING
        self._fmu.reset()

    def free(self) -> None:
        """Free the instance; a second call does nothing."""
        self._fmu.free()

    def get_fmu_state(self) -> _State:
        """Copy the state."""
        return self._fmu.get_fmu_state(), self._schedule

    def set_fmu_state(self, state: _State) -> None:
        """Restore a state of this instance."""
        self._fmu.set_fmu_state(state[0])
        self._schedule = state[1]

    def serialize_fmu_state(self, state: _State) -> bytes:
        """Convert a state to bytes."""
        s = state[1]
        times = [{n: str(x) for n, x in m.items()} for m in (s.next, s.interval, s.last)]
        text = json.dumps([str(s.start), *times, sorted(s.ticked), sorted(s.triggers)]).encode()
        return struct.pack("<Q", len(text)) + text + self._fmu.serialize_fmu_state(state[0])

    def deserialize_fmu_state(self, data: bytes) -> _State:
        """Convert bytes to a state of this instance."""
        try:
            (size,) = struct.unpack("<Q", data[:8])
            start, *times, ticked, triggers = json.loads(data[8 : 8 + size])
            coming, interval, last = ({n: Fraction(x) for n, x in m.items()} for m in times)
        except (struct.error, ValueError):
            raise FmuError(f"{self.path}: {len(data)} bytes that are no serialised state") from None
        sets = frozenset(ticked), frozenset(triggers)
        schedule = _Schedule(Fraction(start), coming, interval, last, *sets)
        return self._fmu.deserialize_fmu_state(data[8 + size :]), schedule

    def binding(self) -> Binding:
        """Return that the stepping loop in C has to call Python."""
        return Binding(BindingKind.CALLBACK, 0, {})

    # ---- the step -----------------------------------------------------------------------------

    def do_step(self, current_communication_point: float, step_size: float) -> None:
        """Activate the partitions whose clocks tick from here until before the step's end."""
        begin = self._now = _exactly(current_communication_point)
        near = _exactly(step_size) * _NEAR
        end = begin + _exactly(step_size) - near
        self._fmu.time = current_communication_point
        self._schedule = replace(self._schedule, ticked=frozenset())
        if self._ask_again:
            self._ask_again = False
            self._tune()
        due = dict.fromkeys(self._schedule.triggers, begin)
        for _ in range(_TICKS):
            ticks = due | {n: t for n, t in self._schedule.next.items() if t < end}
            if not ticks:
                return
            first = min(ticks.values()) + near  # those of one instant, however it was rounded
            name = next(n for n in self._clocks if ticks.get(n, end) <= first)
            due.pop(name, None)
            self._activate(self._clocks[name], ticks[name])
        raise self._wrong(
            f"more than {_TICKS} ticks in a communication step of {step_size:g} s; expected "
            "clocks whose ticks do not accumulate"
        )

    def _activate(self, clock: _InputClock, instant: Fraction) -> None:
        """Activate the partition of a clock; the next tick of a periodic clock is known before."""
        self._now = instant
        self._fmu.time = float(instant)
        last = self._schedule.last.get(clock.name)
        if last is not None and instant <= last:
            raise self._wrong(
                f"clock {clock.name} ticks a second time at this instant; expected at most one "
                "tick at each instant"
            )
        coming = dict(self._schedule.next)
        coming.pop(clock.name, None)
        if clock.timing.is_periodic:
            coming[clock.name] = instant + self._schedule.interval[clock.name]
        self._schedule = replace(
            self._schedule, next=coming, last={**self._schedule.last, clock.name: instant},
            ticked=self._schedule.ticked | {clock.name},
        )  # fmt: skip
        self._fmu.call("ActivateModelPartition", clock.reference, float(instant))
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
        if self._fmu.locks != 0:
            count, self._fmu.locks = self._fmu.locks, 0
            raise self._wrong(
                f"the partition of clock {clock.name} ended with preemption locked {count} times "
                "more than unlocked; expected equal numbers"
            )
        if clock.timing.variability == "changing":
            self._count_down(clock)

    def _clock_update(self) -> None:
        """Take what an active partition reports: output clocks, and intervals of countdowns.

        FMI calls it from C, through which no error passes.
        """
        try:
            ticked = {name for name, r in self._outputs.items() if self._is_active(r)}
            self._schedule = replace(self._schedule, ticked=self._schedule.ticked | ticked)
            for clock in self._clocks.values():
                if clock.timing.variability == "countdown":
                    self._count_down(clock)
        except BaseException as error:
            self._failure = self._failure or error

    # ---- clocks -------------------------------------------------------------------------------

    def _count_down(self, clock: _InputClock) -> None:
        """Ask for the time from now to the next tick; it stays as it is if it has not changed."""
        interval = self._interval(clock)
        if interval is not None:
            coming = {**self._schedule.next, clock.name: self._now + interval}
            self._schedule = replace(self._schedule, next=coming)

    def _tune(self) -> None:
        """Ask for the intervals of tunable clocks, which count from now if they have changed."""
        for clock in self._clocks.values():
            if clock.timing.variability == "tunable" and clock.timing.interval is None:
                interval = self._interval(clock)
                if interval is not None and interval != self._schedule.interval[clock.name]:
                    self._put(clock, interval, self._now + interval)

    def _put(self, clock: _InputClock, interval: Fraction, first: Fraction) -> None:
        self._schedule = replace(
            self._schedule,
            next={**self._schedule.next, clock.name: first},
            interval={**self._schedule.interval, clock.name: interval},
        )

    def _interval(self, clock: _InputClock) -> Fraction | None:
        """Ask for an interval [s]; None if it is not known or, of a countdown, has not changed."""
        value, qualifier = ctypes.c_double(), ctypes.c_int(_NOT_YET_KNOWN)
        self._fmu.call(
            "GetIntervalDecimal", ctypes.byref(ctypes.c_uint32(clock.reference)), 1,
            ctypes.byref(value), ctypes.byref(qualifier),
        )  # fmt: skip
        if qualifier.value == _NOT_YET_KNOWN:
            return None
        if qualifier.value != _CHANGED and clock.timing.variability == "countdown":
            return None
        positive = clock.timing.is_periodic
        if not math.isfinite(value.value) or value.value < 0 or (positive and value.value == 0):
            raise self._wrong(
                f"clock {clock.name} has an interval of {value.value:g} s; expected "
                f"{'more than 0' if positive else '0 or more'}"
            )
        return _exactly(value.value)

    def _shift(self, clock: _InputClock) -> Fraction:
        value = ctypes.c_double()
        reference = ctypes.byref(ctypes.c_uint32(clock.reference))
        self._fmu.call("GetShiftDecimal", reference, 1, ctypes.byref(value))
        if not math.isfinite(value.value) or value.value < 0:
            raise self._wrong(
                f"clock {clock.name} has a shift of {value.value:g} s; expected 0 or more"
            )
        return _exactly(value.value)

    def _is_active(self, reference: int) -> bool:
        active = ctypes.c_bool()
        self._fmu.call(
            "GetClock", ctypes.byref(ctypes.c_uint32(reference)), 1, ctypes.byref(active)
        )
        return active.value

    def _wrong(self, reason: str) -> ComponentFailed:
        return ComponentFailed(self.path, float(self._now), reason)


def _exactly(x: float) -> Fraction:
    """Return the shortest decimal number that is read as `x`, so that 0.1 s is a tenth."""
    return Fraction(repr(float(x)))
