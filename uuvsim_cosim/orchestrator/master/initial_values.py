"""Transfer of values along the connections in Initialization Mode, in the plan's order."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from uuvsim_cosim.errors import FmuError, InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.description_xml import DTYPES
from uuvsim_cosim.orchestrator.master.failure import nan_explanation
from uuvsim_cosim.orchestrator.plan.initial_loop import solve_loop
from uuvsim_cosim.orchestrator.plan.plan import Plan, Transfer
from uuvsim_cosim.orchestrator.values.transformation import listed

__all__ = ["converted", "propagate", "set_inputs"]


def propagate(plan: Plan, components: Sequence[Component], time: float) -> None:
    """Set every connected input from its source, and solve algebraic loops.

    Raises LoopNotConverged. An entry of the order that names one component twice is a loop
    through that component alone.
    """
    # Transfers of solved loops: setting them again would add a rounding error times the gain.
    solved: set[int] = set()
    for entry in plan.initialization:
        members = sorted(set(entry))
        into = [t for i in members for t in plan.to_component.get(i, ())]
        set_inputs(components, [t for t in into if id(t) not in solved])
        if len(entry) > 1:
            inner = [t for t in plan.transfers if t.target in members and t.source in members]
            solved.update(id(t) for t in solve_loop(inner, components, time))
    set_inputs(components, [t for t in plan.transfers if id(t) not in solved])


def set_inputs(components: Sequence[Component], transfers: Iterable[Transfer]) -> None:
    """Set the targets of transfers from the present values of their sources.

    Raises FmuError, which names the sources if a target refuses a value.
    """
    # Clocked variables are exchanged when their clocks tick, at the first instant too.
    transfers = [
        t for t in transfers if not t.source_variable.clocks and not t.target_variable.clocks
    ]
    read: dict[tuple[int, str], np.ndarray] = {}
    pending: dict[tuple[int, str], tuple[Variable, np.ndarray]] = {}
    for t in transfers:
        output, input_ = (t.source, t.source_variable.name), (t.target, t.target_variable.name)
        if output not in read:
            read[output] = _flat(components[t.source], output[1])
        if input_ not in pending:
            variable = components[t.target].description.variables[input_[1]]
            pending[input_] = (variable, _flat(components[t.target], input_[1]))
        values = converted(t, read[output][list(t.source_elements)])
        pending[input_][1][list(t.target_elements)] = _in_target_type(values, t, components)
    for (i, name), (variable, flat) in pending.items():
        try:
            components[i].set(variable, flat.reshape(variable.shape) if variable.shape else flat[0])
        except FmuError as error:
            reasons = f" {variable.unit}" if variable.unit else ""
            for t in transfers:
                source, signal = components[t.source], t.source_variable.name
                values = read[t.source, signal]
                if (t.target, t.target_variable.name) == (i, name):
                    finite = values.dtype.kind != "f" or np.all(np.isfinite(values))
                    why = "" if finite else nan_explanation(source, signal)
                    reasons += f"; {source.path}.{signal} gives it{why}"
            raise FmuError(f"{error}{reasons}") from None


def converted(t: Transfer, values: np.ndarray) -> np.ndarray:
    """Apply a transfer's table, or factor and offset, exactly if they are 1 and 0."""
    if t.table:
        found = dict(t.table)
        for v in values:
            if int(v) not in found:
                raise InputInvalid(
                    f"the connection from {t.source_variable.name} to {t.target_variable.name}",
                    f"{v} has no entry in its table",
                    listed(t.table),
                )
        return np.array([found[int(v)] for v in values], DTYPES[t.target_variable.type])
    if (t.factor, t.offset) == (1.0, 0.0):
        return values
    if values.dtype.kind in "iu" and not all(int(float(x)) == x for x in values.tolist()):
        # Float64 would round these integers.
        exact: np.ndarray = Fraction(t.factor) * values.astype(object) + Fraction(t.offset)
        return exact
    return t.factor * values + t.offset


def _in_target_type(values: np.ndarray, t: Transfer, components: Sequence[Component]) -> np.ndarray:
    """Return numbers in the target's type, converted in the same way as by the stepping loop.

    Raises FmuError for a number that the type cannot hold: an integer beyond its range, or one
    with more digits than a Float64 has.
    """
    type_ = t.target_variable.type
    dtype = np.dtype(DTYPES[type_])
    if dtype.kind in "Ob" or values.dtype == dtype:
        return values.astype(dtype)
    whole: list[Any] = values.tolist()
    if dtype.kind == "f":
        fits = values.dtype.kind not in "iuO" or all(float(x) == x for x in whole)
    else:
        if values.dtype.kind == "f":  # half away from zero
            whole = [int(x + math.copysign(0.5, x)) if abs(x) < 2**52 else x for x in whole]
        limits = np.iinfo(dtype)
        fits = all(math.isfinite(x) and limits.min <= x <= limits.max for x in whole)
        fits = fits and all(x == int(x) for x in whole)
        whole = [int(x) for x in whole] if fits else whole
    if not fits:
        source, target = components[t.source].path, components[t.target].path
        given = ", ".join(str(x) for x in values.tolist())
        raise FmuError(
            f"{target}.{t.target_variable.name}",
            (
                f"the value {given} of {source}.{t.source_variable.name} does not "
                f"fit {type_}{' exactly' * (dtype.kind == 'f')}"
            ),
            "a value that does, or a connection of equal types",
        )
    return np.array(whole, dtype)


def _flat(component: Component, name: str) -> np.ndarray:
    """Return a variable's present value as an array of one dimension."""
    variable = component.description.variables[name]
    value = component.get(variable)
    if isinstance(value, bytes):
        flat = np.empty(1, object)
        flat[0] = value
        return flat
    if isinstance(value, str):
        return np.array([value], object)
    return np.array(value, DTYPES[variable.type]).ravel()
