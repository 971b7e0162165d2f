"""Errors for a stopped stepping loop: component, variable and time of the failure."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from uuvsim_cosim.errors import ComponentFailed, LoopNotConverged, UuvsimError
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.orchestrator.master.callback import CallbackBinding
from uuvsim_cosim.orchestrator.master.core_library import Action, Failure, Outcome, Type
from uuvsim_cosim.orchestrator.master.core_tables import Tables, fmi_name
from uuvsim_cosim.orchestrator.master.shared import SharedBinding
from uuvsim_cosim.orchestrator.values.transformation import listed

__all__ = ["error_of", "last_messages", "nan_explanation"]

_BECAME = re.compile(r'"([^"]+)" became ')  # text of messages in the shells of fmus/runtime
_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")


def error_of(
    failure: Failure, tables: Tables, components: Sequence[Component], time: float
) -> BaseException:
    """Return the error to raise; an exception of a component in Python is returned as it is."""
    if failure.outcome == Outcome.NOT_CONVERGED:
        return _not_converged(failure, tables, components, time)
    binding = tables.bindings[failure.member]
    component = components[tables.order[failure.member]]
    if isinstance(binding, SharedBinding) and (lost := binding.exchange.error(time)) is not None:
        return lost
    if failure.outcome == Outcome.NO_MEMORY:
        return UuvsimError(f"{component.path}: no memory for a text or binary value")
    if failure.outcome == Outcome.BAD_STATUS and isinstance(binding, CallbackBinding):
        error = binding.callbacks.error
        if error is None:  # only a signal's exception can escape; another hook has received it
            return KeyboardInterrupt()
        if isinstance(error, UuvsimError) or not isinstance(error, Exception):
            return error
        return ComponentFailed(component.path, time, f"{type(error).__name__}: {error}")
    own = getattr(component, "failure", None)  # an FMU names its status and its messages
    if failure.outcome == Outcome.BAD_STATUS and own is not None:
        action = Action(failure.action)
        if action == Action.DO_STEP:
            function = "DoStep"
        elif action in (Action.GET_STATE, Action.SET_STATE):
            function = action.name.title().replace("_State", "FMUState")
        elif action > Action.SET_STATE:
            function = action.name.title().replace("_", "")
        else:
            placed, _ = tables.placed_at(failure.slot)
            function = fmi_name(binding.kind, action, Type.of(placed.variable))
        failed: ComponentFailed = own(function, failure.status, time)
        became = _BECAME.search(failed.reason)
        why = nan_explanation(component, became[1]) if became else ""
        if not why:
            return failed
        return ComponentFailed(failed.path, failed.time, failed.reason + why, failed.asks_to_end)
    reason = _reason(failure, tables, component) + last_messages(component)
    return ComponentFailed(component.path, time, reason, failure.outcome == Outcome.ENDED)


def _not_converged(
    failure: Failure, tables: Tables, components: Sequence[Component], time: float
) -> LoopNotConverged:
    placed, element = tables.placed_at(failure.slot)
    i = tables.order[placed.member]
    path = components[i].path
    group = next(g for g in tables.plan.groups if i in g.members)
    inside = (t for t in tables.plan.transfers if {t.source, t.target} <= set(group.members))
    hops = [tables.plan.hop(t) for t in inside]
    where = f"{path}.{placed.variable.element_name(element)}"
    numeric = Type.of(placed.variable) <= Type.Float32
    final = (
        f"residual {failure.residual:.3g} at {where}" if numeric else f"{where} changes each time"
    )
    chosen = any(set(loop.members) <= set(group.members) for loop in tables.plan.algebraic_loops)
    delay = ', or the loop policy "delay" (--loops delay)' if chosen else ""
    return LoopNotConverged(
        f"iterated group {', '.join(hops)}: inputs and outputs do not agree in the step from "
        f"t = {time:.9g} s by the solver {group.solver!r}; {final} after {failure.status} "
        "iterations; expected a loop with a solution (its gain is not 1), another solver, or a "
        f"smaller step{delay}"
    )


def _reason(failure: Failure, tables: Tables, component: Component) -> str:
    """Return the text for a failure without an error of the component itself."""
    outcome = Outcome(failure.outcome)
    if outcome == Outcome.NOT_FINITE:
        placed, element = tables.placed_at(failure.slot)
        name = placed.variable.element_name(element)
        read = [
            float(values[failure.slot : failure.slot + 1].view("f8")[0])
            for values in (tables.core.slots, tables.core.fresh)
        ]
        value = next((v for v in read if not math.isfinite(v)), "not finite")
        return f"output {name} is {value}; expected a finite number"
    if outcome == Outcome.STATE_NOT_FINITE:
        offset, name = failure.status, "a value"  # value references are offsets
        for v in component.description.variables.values():
            first = v.value_references[0] if v.value_references else -1
            if 0 <= first <= offset < first + v.size and Type.of(v) == Type.Float64:
                name = v.element_name(offset - first)
                break
        why = nan_explanation(component, name)
        return f"{name} is not finite after a step; expected finite numbers{why}"
    if outcome == Outcome.OUT_OF_RANGE:
        placed, element = tables.placed_at(failure.slot)
        name = placed.variable.element_name(element)
        target = tables.order[placed.member], placed.variable.name
        for t in tables.plan.transfers:
            is_source = (t.target, t.target_variable.name) == target
            if is_source and t.table and element in t.target_elements:
                return (
                    f"the value connected to input {name} has no entry in its table; expected "
                    f"{listed(t.table)}"
                )
        exactly = " exactly" if placed.variable.type.startswith("Float") else ""
        return f"the value connected to input {name} does not fit {placed.variable.type}{exactly}"
    if outcome == Outcome.NOT_RESTORED:
        placed, element = tables.placed_at(failure.slot % tables.core.slots.size)
        name = placed.variable.element_name(element)
        return (
            f"its state was restored before a step of variable length was repeated, and output "
            f"{name} has another value than before the step; expected a component that restores "
            "its whole state, or rollback=no"
        )
    if outcome == Outcome.EVENTS_DO_NOT_END:
        group = next(g for g in tables.plan.events or () if tables.order[failure.member] in g)
        names = ", ".join(tables.plan.components[i].path for i in group)
        if failure.status == 2:
            cause = f"clock {tables.clocks[failure.member][failure.slot].name} ticks each time"
        elif failure.status:
            cause = "it needs another round of fmi3UpdateDiscreteStates"
        else:
            placed, element = tables.placed_at(failure.slot)
            owner = tables.plan.components[tables.order[placed.member]].path
            cause = f"input {owner}.{placed.variable.element_name(element)} changes each time"
        return (
            f"the event iteration of {names} at t = {failure.residual:.9g} s does not end: after "
            f"100 rounds {cause}; expected a fixed point"
        )
    if outcome == Outcome.BAD_INTERVAL:
        clock = tables.clocks[failure.member][failure.slot]
        least = "more than 0 s" if clock.timing and clock.timing.is_periodic else "0 s or more"
        return (
            f"the interval of clock {clock.name} is {failure.value:.9g} s at "
            f"t = {failure.residual:.9g} s; expected {least}"
        )
    if outcome == Outcome.NO_PROGRESS:
        cause = "fmi3DoStep returned early without progress"
        if failure.status:
            cause = "there are more than 100000 events in one step"
        return f"{cause}, at t = {failure.residual:.9g} s; expected time to go on after an event"
    if outcome == Outcome.NOT_REPEATED:
        other = tables.plan.components[tables.order[failure.slot]].path
        return (
            f"it returned early at t = {failure.residual:.9g} s, and {other}, which has events "
            "together with it, went further and cannot restore its state "
            "(canGetAndSetFMUState); expected a component that restores its state, or a run "
            "without events"
        )
    if outcome == Outcome.ENDED:
        return "it asks to end the simulation"
    if outcome == Outcome.EARLY_RETURN:
        return "it returned from a step before the step's end, which was not allowed"
    status = failure.status
    word = _STATUS[status] if 0 <= status < len(_STATUS) else "a status that FMI does not know"
    return f"{Action(failure.action).name.lower()} returned {word} ({status})"


def nan_explanation(component: Component, name: str) -> str:
    """Return a variable's description if it explains when it is NaN, for the end of an error."""
    variable = component.description.variables.get(split_element_name(name)[0])
    description = "" if variable is None else variable.description
    return f" ({description})" if "NaN" in description else ""


def last_messages(component: Component) -> str:
    """Return the last messages of a component, for the end of an error."""
    drain = getattr(component, "drain_messages", None)
    if drain is not None:
        drain()
    messages: list[tuple[str, str]] = getattr(component, "messages", [])
    texts = [text for _, text in messages[-3:]]
    return f"; its last messages: {' | '.join(texts)}" if texts else ""
