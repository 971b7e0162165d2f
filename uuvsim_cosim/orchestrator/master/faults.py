"""Faults of signals: receivers of an output get a changed value; the component is not changed."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, final, get_args

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.master.core_tables import Tables
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.values.endpoints import resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = ["Fault", "FaultKind", "Faults", "KeptFault", "hash_of_seeds"]

FaultKind = Literal["override", "bias", "scale", "freeze", "delay", "drop"]
_NEEDS = {
    "override": "the value that others see", "bias": "what is added", "scale": "a factor",
    "freeze": "nothing", "delay": "seconds", "drop": "a probability in [0, 1]",
}  # fmt: skip


@dataclass(frozen=True)
class Fault:
    """Fault of a `signal`: of an output, or of elements of it ("dvl.beam_velocity[1]").

    `kind` is "override", "bias", "scale", "freeze", "delay" or "drop". `value` is in the variable's
    unit; for "scale" a factor, for "delay" in seconds, for "drop" the probability that a sample is
    lost, so that receivers get the previous one again. "freeze" needs none. `Master.faults` checks
    it.

    Example: a depth that all receivers see 0.5 m too deep.

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.orchestrator import Fault, flatten, prepare
    >>> plan = flatten(uuv.load("bluerov2_hold"))
    >>> with uuv.Master(plan, prepare(plan)) as master:
    ...     master.initialize()
    ...     before = master.get("hull", "eta")[2]
    ...     number = master.faults.add(Fault("hull.eta[3]", "bias", 0.5))
    ...     master.step()
    ...     print(f"{master.get('hull', 'eta')[2] - before:.2f} m")
    0.50 m
    """

    signal: str
    kind: FaultKind
    value: float = 0.0


@dataclass(frozen=True)
class KeptFault:
    """Fault in a snapshot, with the past values of each of its elements: (head, values)."""

    number: int
    fault: Fault
    past: tuple[tuple[int, bytes], ...]


@final
class Faults:
    """Active faults of a running master; `seed` determines which samples are dropped."""

    def __init__(self, tables: Tables, seed: int) -> None:
        self._tables = tables
        self._seed = seed % 2**64
        self._active: dict[int, tuple[Fault, tuple[int, ...]]] = {}
        self._next = 1
        self._next_id = 1

    @property
    def active(self) -> dict[int, Fault]:
        """Return the faults by number."""
        return {number: fault for number, (fault, _) in self._active.items()}

    def add(self, fault: Fault) -> int:
        """Make a signal faulty from now on, and return the fault's number for `clear`."""
        number, self._next = self._next, self._next + 1
        self._add(number, fault)
        return number

    def clear(self, number: int | None = None) -> None:
        """Remove a fault, or all."""
        numbers = list(self._active) if number is None else [number]
        for n in numbers:
            if n not in self._active:
                known = ", ".join(map(str, self._active)) or "there is none"
                raise InputInvalid(f"no fault {n}", f"one of {known}")
            for i in self._active.pop(n)[1]:
                self._tables.core.clear_fault(i)

    def kept(self) -> tuple[KeptFault, ...]:
        """Copy the faults and their past values, for a snapshot."""
        return tuple(
            KeptFault(n, fault, tuple(self._tables.core.fault_past(i) for i in ids))
            for n, (fault, ids) in self._active.items()
        )

    def restore(self, kept: Iterable[KeptFault]) -> None:
        """Replace the faults by those of a snapshot."""
        self.clear()
        for k in kept:
            self._add(k.number, k.fault)
            for i, (head, past) in zip(self._active[k.number][1], k.past, strict=True):
                self._tables.core.set_fault_past(i, head, past)
            self._next = max(self._next, k.number + 1)

    def _add(self, number: int, fault: Fault) -> None:
        """Check a fault, and add one to the core for each element; raises InputInvalid."""
        plan, core = self._tables.plan, self._tables.core
        descriptions = {c.path: c.description for c in plan.components}
        try:
            point = resolve_endpoint(fault.signal, descriptions)
        except Misfit as misfit:
            raise InputInvalid(str(misfit.at(fault.signal))) from None
        index = next(i for i, c in enumerate(plan.components) if c.path == point.element)
        placed = self._tables.outputs.get((index, point.variable.name))
        if placed is None:
            names = [f"{plan.components[i].path}.{n}" for i, n in self._tables.outputs]
            raise InputInvalid(
                fault.signal,
                "is no output that is connected or recorded",
                expected_names(fault.signal, names),
            )
        if fault.kind not in get_args(FaultKind):
            known = expected_names(fault.kind, get_args(FaultKind))
            raise InputInvalid(fault.signal, f"fault {fault.kind!r}", known)
        if placed.variable.type in ("String", "Binary"):
            raise InputInvalid(
                fault.signal, f"is a {placed.variable.type}", "a number or a Boolean"
            )
        bad = not math.isfinite(fault.value)
        bad |= fault.kind == "drop" and not 0.0 <= fault.value <= 1.0
        # Values go to C as doubles: an integer must not change by that.
        is_float = placed.variable.type in ("Float64", "Float32")
        bad |= fault.kind in ("override", "bias") and not (
            is_float or float(fault.value) == fault.value == int(fault.value)
        )
        if plan.variable is not None and fault.kind in ("delay", "drop"):
            raise InputInvalid(
                fault.signal,
                f"fault {fault.kind!r}, with a variable communication step",
                "override, bias, scale or freeze, or a fixed step: it counts samples",
            )
        i = self._tables.order[placed.member]
        group = plan.event_group_of
        if i in group and any(
            t.source_variable.name == placed.variable.name and group.get(t.target) == group[i]
            for t in plan.from_component.get(i, ())
        ):
            raise InputInvalid(
                fault.signal,
                "is exchanged at the instant of an event, which a fault does not change",
                "another output, or a run without events",
            )
        n = 1  # past samples that the fault keeps
        if fault.kind == "delay" and not bad:
            step = plan.components[self._tables.order[placed.member]].step_ticks * plan.tick
            samples = Fraction(str(fault.value)) / step
            if samples < 1 or samples.denominator != 1:
                raise InputInvalid(
                    fault.signal,
                    f"delay {fault.value:g} s",
                    f"a whole number of the component's steps of {float(step):g} s",
                )
            n = int(samples)
        if bad:
            raise InputInvalid(fault.signal, f"{fault.kind} {fault.value:g}", _NEEDS[fault.kind])
        kind = get_args(FaultKind).index(fault.kind) + 1
        ids = tuple(range(self._next_id, self._next_id + len(point.elements)))
        self._next_id += len(ids)
        for i, e in zip(ids, point.elements, strict=True):
            slot = placed.slot + e
            core.fault(i, placed.member, slot, kind, float(fault.value), n, self._seed)
        self._active[number] = (fault, ids)


def hash_of_seeds(plan: Plan) -> int:
    """Return a seed for the faults, derived from the seed of the first component."""
    first, second = plan.components[0].seed if plan.components else (0, 0)
    return (first % 2**32) << 32 | second % 2**32
