"""Restart or replacement of a component during a run: its plan, state, inputs and values."""

from __future__ import annotations

import logging
from dataclasses import replace

from uuvsim_cosim.errors import FmuError, InputInvalid, Problem, SystemInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.isolation.isolated import RemoteState
from uuvsim_cosim.orchestrator.master.core_library import decode, encode, read_blob, write_blob
from uuvsim_cosim.orchestrator.master.core_tables import Tables
from uuvsim_cosim.orchestrator.plan.algebraic_loops import check_loops
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.values.values import is_float

__all__ = ["copy_values", "plan_with", "set_inputs", "state_of_new_instance", "transferable_state"]

log = logging.getLogger("uuvsim_cosim.master")


# ---- a state that outlives its instance -------------------------------------------------------


def transferable_state(old: Component, state: object) -> object:
    """Return a state, or its bytes, in a form that a new instance can use.

    Raises InputInvalid if there is none.
    """
    if state is None:  # that of a native component is in the image
        return None
    reason = ""
    if not isinstance(state, RemoteState):
        try:
            return old.serialize_fmu_state(state)
        except FmuError as error:
            reason = f" ({error})"
    elif state.data is not None:
        return state
    raise InputInvalid(
        f"restart: {old.path} cannot serialise its state{reason}, so its part of the "
        "snapshot was lost with the failed instance; expected a component that can, or "
        'snapshot="start"'
    )


def state_of_new_instance(fresh: Component, state: object) -> object:
    """Return a state of `transferable_state` as a state of the new instance."""
    return fresh.deserialize_fmu_state(state) if isinstance(state, bytes) else state


# ---- another source ---------------------------------------------------------------------------


def plan_with(plan: Plan, i: int, source: str) -> Plan:
    """Return the plan with another component i; raises SystemInvalid if it does not fit."""
    resolved = resolve(source)
    old = plan.components[i]
    ends = [t.source_variable for t in plan.transfers if t.source == i]
    ends += [t.target_variable for t in plan.transfers if t.target == i]
    described = resolved.describe()
    variables = dict(described.variables)
    for (
        v
    ) in ends:  # variables without a unit get that of the replaced ones, as `System.replace` does
        new = variables.get(v.name)
        if new is None or not is_float(new) or None not in new.units or new.size != v.size:
            continue
        units = tuple(b or a for a, b in zip(v.units, new.units, strict=True))
        if units != new.units:
            same = len(set(units)) == 1
            variables[v.name] = replace(
                new, unit=units[0] if same else None, element_units=() if same else units
            )
            log.warning("%s.%s: states no unit; %s is assumed", old.path, v.name, v.unit_text)
    described = replace(described, variables=variables)
    problems: dict[str, Problem] = {}
    for v in ends:
        place, new = f"{old.path}.{v.name}", described.variables.get(v.name)
        expected = f"{v.causality} of type {v.type} and shape {v.shape}, unit {v.unit}"
        if new is None:
            problems[v.name] = Problem(place, f"{described.name} has none", expected)
        elif (new.type, new.shape, new.causality, new.units) != (
            v.type, v.shape, v.causality, v.units,
        ):  # fmt: skip
            read = f"{new.causality} of type {new.type} and shape {new.shape}, unit {new.unit}"
            problems[v.name] = Problem(place, read, expected)
    if problems:
        raise SystemInvalid(list(problems.values()))
    start = {n: v for n, v in old.start.items() if n in described.variables}
    if lacking := sorted(old.start.keys() - start.keys()):
        log.warning("%s: %s has no %s, whose start values are not used", old.path, source,
                    ", ".join(lacking))  # fmt: skip
    component = replace(old, source=resolved.text, description=described, start=start)
    transfers = []
    for t in plan.transfers:
        if t.source == i:
            t = replace(t, source_variable=described.variables[t.source_variable.name])
        if t.target == i:
            t = replace(t, target_variable=described.variables[t.target_variable.name])
        transfers.append(t)
    components = (*plan.components[:i], component, *plan.components[i + 1 :])
    return check_loops(replace(plan, components=components, transfers=tuple(transfers)))


def set_inputs(fresh: Component, tables: Tables, i: int) -> None:
    """Set the inputs that a new component shares with component i to their present values."""
    for (j, name), p in tables.inputs.items():
        if j == i and name in fresh.description.variables:
            fresh.set(fresh.description.variables[name], decode(p.variable, tables.raw(p)))


def copy_values(before: Tables, after: Tables, i: int, fresh: Component) -> None:
    """Copy the values from the slots before to those after; of component i, read the new values."""
    memories = [
        (before.core.slots, after.core.slots), (before.core.fresh, after.core.fresh)
    ]  # fmt: skip
    for old, new in ((before.inputs, after.inputs), (before.outputs, after.outputs)):
        for key, to in new.items():
            for there, here in memories:
                source, target = old[key].view(there), to.view(here)
                if key[0] == i:
                    encode(to.variable, fresh.get(to.variable), target)
                elif to.variable.type in ("String", "Binary"):  # the slots hold pointers
                    for k in range(to.variable.size):
                        write_blob(target, k, read_blob(source, k))
                else:
                    target[:] = source
