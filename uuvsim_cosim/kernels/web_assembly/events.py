"""Events of a scenario by communication point and element, as `timeline.js` applies them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.scenarios.played import Played, events_of
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, Scenario
from uuvsim_cosim.orchestrator.values.endpoints import resolve_endpoint

__all__ = ["timeline_events"]


def timeline_events(plan: Plan, scenario: Scenario) -> list[dict[str, Any]]:
    """Return the events of a scenario for a timeline: points, elements, and values in own units.

    Raises InputInvalid for an event that the master refuses as well.
    """
    shown = [(c.path, v.name) for c in plan.components for v in c.description.of("output")]
    with Master(plan, prepare(plan, "native"), live=shown) as master:
        master.initialize()
        Played(master, scenario)  # checks all events
        return [
            found
            for event in scenario.events
            for single in events_of(event, master)
            for found in (
                _changes(single, master)
                if isinstance(single, Change)
                else _faults(single.fault.signal, plan, {
                    "at": _point(single.at, plan), "until": _point(single.until, plan),
                    "kind": single.fault.kind, "value": float(single.fault.value),
                })
            )
        ]  # fmt: skip


def _point(time: float, plan: Plan) -> int | None:
    """Return the first communication point at or after a time; None for never."""
    return None if math.isinf(time) else math.ceil(Fraction(str(time)) / plan.tick)


def _changes(change: Change, master: Master) -> Iterator[dict[str, Any]]:
    plan = master.plan
    at = _point(change.at, plan)
    if at is None:
        return
    point = resolve_endpoint(change.variable, {c.path: c.description for c in plan.components})
    path, name = point.element, point.variable.name
    value: Any = change.value if isinstance(change.value, list) else [change.value]
    if point.whole:
        value = np.ravel(np.asarray(master.fitted(path, name, change.value), float))
    elif len(value) == 1:
        value = list(value) * len(point.elements)
    for k, x in zip(point.elements, value, strict=True):
        yield {"at": at, "name": f"{path}.{name}", "element": k, "value": float(x)}


def _faults(signal: str, plan: Plan, fault: dict[str, Any]) -> Iterator[dict[str, Any]]:
    point = resolve_endpoint(signal, {c.path: c.description for c in plan.components})
    for element in [None] if point.whole else point.elements:
        yield fault | {"signal": f"{point.element}.{point.variable.name}", "element": element}
