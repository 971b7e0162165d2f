"""A component that failed is restarted, or another takes its place, and the run goes on."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.errors import FmuError, InputInvalid, Problem, SystemInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.fmus.isolated import RemoteState
from uuvsim_cosim.orchestrator.core_tables import Tables
from uuvsim_cosim.orchestrator.plan import Plan, Transfer
from uuvsim_cosim.orchestrator.slots import decode, encode, read_blob, write_blob
from uuvsim_cosim.orchestrator.snapshot import Snapshot
from uuvsim_cosim.orchestrator.start import enter_initialization
from uuvsim_cosim.orchestrator.values import is_float

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.master import Master

__all__ = ["replace_component", "restart_component"]

log = logging.getLogger("uuvsim_cosim.master")


def restart_component(master: Master, i: int, snapshot: Snapshot | None) -> None:
    """Make component i anew, and go on from a snapshot, or from the start."""
    old, planned = master.components[i], master.plan.components[i]
    was_last = snapshot is not None and snapshot is master._last
    states = () if snapshot is None else (snapshot.states[i],)
    outliving = [_outliving(old, state) for state in states]
    fresh = master._instantiate(planned)
    try:
        if snapshot is not None:
            enter_initialization(planned, fresh, {}, None, master._times)
            fresh.exit_initialization_mode()
            kept = [_taken_over(fresh, state) for state in outliving]
            snapshot = replace(snapshot, states=_with(snapshot.states, i, kept[0]))
        tables = master._ready()
        next_row = tables.core.next_row
        tables.replace(tables.order.index(i), fresh)
    except BaseException:
        fresh.free()
        raise
    master._take_in(i, fresh)
    old.free()
    if snapshot is None:
        master.reset()
        return
    master.restore(snapshot)
    if was_last:  # the state of the instance that is gone went with it
        master._last = snapshot
    master._ready().core.next_row = next_row


def replace_component(master: Master, i: int, snapshot: Snapshot | None, source: str) -> None:
    """Put a component of another source in the place of component i, and go on.

    It goes through Initialization Mode at the snapshot's time, with the inputs of then.
    """
    plan = _planned(master.plan, i, source)
    old, before = master.components[i], master._ready()
    next_row = before.core.next_row
    if snapshot is not None:
        master._state.restore(snapshot, without=i)
        image = before.core.get_image()
    fresh = master._instantiate(plan.components[i])
    try:
        times = (master.time, master._times[1]) if snapshot is not None else master._times
        enter_initialization(plan.components[i], fresh, {}, None, times)
        for name, (variable, raw) in _inputs(before, i).items():
            if name in fresh.description.variables:
                fresh.set(fresh.description.variables[name], decode(variable, raw))
        fresh.exit_initialization_mode()
        master._take_in(i, fresh, plan)
    except BaseException:
        fresh.free()
        raise
    old.free()
    if snapshot is None:
        master.reset()
        return
    after = master._ready()
    _copy_values(before, after, i, fresh)
    clock = 8 * (1 + after.core.n_members)  # the image begins with it
    after.core.set_image(image[:clock] + after.core.get_image()[clock:])
    master.faults.restore(snapshot.faults)
    after.core.next_row = next_row


def _with(states: tuple[Any, ...], i: int, state: Any) -> tuple[Any, ...]:
    return (*states[:i], state, *states[i + 1 :])


# ---- a state that outlives its instance -------------------------------------------------------


def _outliving(old: Component, state: Any) -> Any:
    """Give a state, or its bytes, that a fresh instance can take over; or refuse."""
    if state is None:  # a native component's is in the image
        return None
    if isinstance(state, RemoteState):
        if state.data is not None:
            return state
        reason = ""
    else:
        try:
            return old.serialize_fmu_state(state)
        except FmuError as error:
            reason = f" ({error})"
    raise InputInvalid(
        f"restart: {old.path} cannot serialise its state{reason}, so what the snapshot holds of "
        'it went with the failed instance; expected a component that can, or snapshot="start"'
    )


def _taken_over(fresh: Component, state: Any) -> Any:
    return fresh.deserialize_fmu_state(state) if isinstance(state, bytes) else state


# ---- another source ---------------------------------------------------------------------------


def _planned(plan: Plan, i: int, source: str) -> Plan:
    """Give the plan with another component i; raises SystemInvalid if that does not fit."""
    from uuvsim_cosim.orchestrator.sources import resolve

    resolved = resolve(source)
    old = plan.components[i]
    ends = [t.source_variable for t in plan.transfers if t.source == i]
    ends += [t.target_variable for t in plan.transfers if t.target == i]
    described = _assuming(resolved.describe(), ends, old.path)
    problems = {v.name: p for v in ends if (p := _misfit(old.path, v, described)) is not None}
    if problems:
        raise SystemInvalid(list(problems.values()))
    start = {n: v for n, v in old.start.items() if n in described.variables}
    if lacking := sorted(old.start.keys() - start.keys()):
        log.warning("%s: %s has no %s, whose start values are not used", old.path, source,
                    ", ".join(lacking))  # fmt: skip
    component = replace(old, source=resolved.text, description=described, start=start)
    transfers = tuple(_rewired(t, i, described) for t in plan.transfers)
    return replace(plan, components=_with(plan.components, i, component), transfers=transfers)


def _assuming(described: Description, ends: Sequence[Variable], path: str) -> Description:
    """Give the units of the place to variables that name none, as `System.replace` does."""
    variables = dict(described.variables)
    for old in ends:
        new = variables.get(old.name)
        if new is None or not is_float(new) or None not in new.units or new.size != old.size:
            continue
        units = tuple(b or a for a, b in zip(old.units, new.units, strict=True))
        if units != new.units:
            same = len(set(units)) == 1
            variables[old.name] = replace(
                new, unit=units[0] if same else None, element_units=() if same else units
            )
            log.warning("%s.%s: names no unit; %s is assumed", path, old.name, old.unit_text)
    return replace(described, variables=variables)


def _misfit(path: str, old: Variable, described: Description) -> Problem | None:
    new = described.variables.get(old.name)
    expected = f"{old.causality} of type {old.type} and shape {old.shape}, unit {old.unit}"
    if new is None:
        return Problem(f"{path}.{old.name}", f"{described.name} has none", expected)
    if (new.type, new.shape, new.causality, new.units) != (
        old.type, old.shape, old.causality, old.units,
    ):  # fmt: skip
        read = f"{new.causality} of type {new.type} and shape {new.shape}, unit {new.unit}"
        return Problem(f"{path}.{old.name}", read, expected)
    return None


def _rewired(t: Transfer, i: int, described: Description) -> Transfer:
    if t.source == i:
        t = replace(t, source_variable=described.variables[t.source_variable.name])
    if t.target == i:
        t = replace(t, target_variable=described.variables[t.target_variable.name])
    return t


def _inputs(tables: Tables, i: int) -> dict[str, tuple[Variable, Any]]:
    slots = tables.core.slots
    return {
        name: (p.variable, slots[p.slot : p.slot + p.variable.size])
        for (j, name), p in tables.inputs.items()
        if j == i
    }


def _copy_values(before: Tables, after: Tables, i: int, fresh: Component) -> None:
    """Bring values to where they lie now; those of component i are the fresh one's."""
    places = [(before.inputs, after.inputs), (before.outputs, after.outputs)]
    for old, new in places:
        for key, to in new.items():
            size, a = to.variable.size, to.slot
            for there, here in (
                (before.core.slots, after.core.slots),
                (before.core.fresh, after.core.fresh),
            ):
                if key[0] == i:
                    encode(to.variable, fresh.get(to.variable), here[a : a + size])
                    continue
                b = old[key].slot
                if to.variable.type not in ("String", "Binary"):
                    here[a : a + size] = there[b : b + size]
                    continue
                for k in range(size):
                    write_blob(here[a:], k, read_blob(there[b:], k))
