"""Overrides and biases of variables (as in libcosim) as faults and changes of a given system."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.faults import Fault
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, Event, Manipulation, SignalFault
from uuvsim_cosim.orchestrator.values.endpoints import Endpoint, resolve_endpoint
from uuvsim_cosim.orchestrator.values.values import Misfit

__all__ = ["events_of"]


def events_of(event: Event, master: Master) -> Sequence[Change | SignalFault]:
    """Return the event, or the events that a manipulation of a variable means in this system.

    An output gets a fault. A parameter or an unconnected input gets a change (a bias adds to its
    present value), and at `until` its present value again. For a connected input, the output that
    feeds it gets a fault, if it feeds no other input. Raises InputInvalid in all other cases.
    """
    if not isinstance(event, Manipulation):
        return (event,)
    plan = master.plan
    try:
        point = resolve_endpoint(event.variable, {c.path: c.description for c in plan.components})
    except Misfit as misfit:
        raise InputInvalid(str(misfit.at(event.variable))) from None
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
                f"the output that feeds it, {signal}",
            )
        if others:
            raise InputInvalid(
                event.variable,
                f"is connected to {signal}, which feeds {', '.join(others)} too",
                f"an unconnected input, or {signal} itself, for all that it feeds",
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
