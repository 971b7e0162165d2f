"""Start values and seeds of components before Initialization Mode."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent
from uuvsim_cosim.orchestrator.plan.seeds import component_seed

__all__ = ["Starts", "enter_initialization", "seed_of", "set_start", "variable_of"]

Starts = Mapping[str, Mapping[str, object]]  # component's path -> variable's name -> value


def variable_of(component: Component, name: str) -> Variable:
    """Find a variable; raises InputInvalid with the known names."""
    variables = component.description.variables
    if name not in variables:
        raise InputInvalid(
            component.path, f"no variable {name!r}", f"one of {', '.join(sorted(variables))}"
        )
    return variables[name]


def enter_initialization(
    planned: PlannedComponent,
    component: Component,
    values: Mapping[str, object],
    seed: int | None,
    times: tuple[float, float | None],
) -> None:
    """Set the plan's start values, then `values`; enter with `times` (start, stop) [s]."""
    set_start(planned, component, {**planned.start, **values}, seed)
    component.enter_initialization_mode(*times)


def seed_of(component: Component, values: Mapping[str, object]) -> Variable | None:
    """Find the parameter for the component's seed; None if it has none, or `values` set it."""
    own = component.description.variables.get("seed")
    if own is None or (own.causality, own.shape) != ("parameter", (2,)) or "seed" in values:
        return None
    return own


def set_start(
    planned: PlannedComponent, component: Component, values: Mapping[str, object], seed: int | None
) -> None:
    """Set values and the component's seed: the plan's, or that of another system `seed`."""
    own = seed_of(component, values)
    if own is not None:
        key = planned.seed if seed is None else component_seed(seed, planned.path)
        component.set(own, np.array(key, np.int32))
    for name, value in values.items():
        component.set(variable_of(component, name), value)
