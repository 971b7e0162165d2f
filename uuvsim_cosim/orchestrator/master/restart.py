"""Reset of a run: back to Initialization Mode and through it again, without a reload."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.fmu_binary import FmuBinary
from uuvsim_cosim.fmus.model_exchange.component import ModelExchange
from uuvsim_cosim.fmus.scheduled_execution.component import ScheduledExecution
from uuvsim_cosim.orchestrator.master.core_library import Failure, Outcome, Type
from uuvsim_cosim.orchestrator.master.core_tables import Tables
from uuvsim_cosim.orchestrator.master.initial_values import propagate
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.plan.seeds import component_seeds
from uuvsim_cosim.orchestrator.plan.start import Starts, enter_initialization, seed_of

__all__ = ["InstancePool", "Restart", "is_pooled"]


def is_pooled(component: Component) -> bool:
    """Return whether a reset replaces the component: an FMU of this process without states.

    Python classes and isolated components have a `reset` that restores their initial state.
    """
    able = component.description.can_get_and_set_state
    return not able and isinstance(component, FmuBinary | ModelExchange | ScheduledExecution)


@final
class InstancePool:
    """Spare instances of an FMU that cannot copy its state: each reset uses the next one.

    They are also made in advance. A further instance neither unpacks the archive nor loads the
    library again.
    """

    def __init__(self, make: Callable[[], Component]) -> None:
        self._make = make
        self._spare: list[Component] = []

    def __len__(self) -> int:
        """Return the number of spare instances."""
        return len(self._spare)

    def fill(self, n: int, component: Component) -> None:
        """Make instances until n are spare; none if the FMU can be instantiated only once."""
        if component.description.can_be_instantiated_only_once:
            return
        while len(self._spare) < n:
            self._spare.append(self._make())

    def exchange(self, used: Component) -> Component:
        """Free a used instance, and return a new one."""
        used.free()
        return self._spare.pop() if self._spare else self._make()

    def free(self) -> None:
        """Free the spare instances."""
        while self._spare:
            self._spare.pop().free()


@final
class Restart:
    """Resets of a run; everything that they have in common is looked up once.

    `components` is the master's own list: if an FMU cannot copy its state, a new instance replaces
    it in the list and in the tables.
    """

    def __init__(
        self,
        plan: Plan,
        tables: Tables,
        components: list[Component],
        pools: Sequence[InstancePool],
        times: tuple[float, float | None],
    ) -> None:
        self._plan, self._tables, self._components = plan, tables, components
        self._pools, self._times = pools, times
        found = (
            (i, seed_of(c, p.start))
            for i, (p, c) in enumerate(zip(plan.components, components, strict=True))
        )
        self._seeds: dict[int, Variable] = {i: v for i, v in found if v is not None}
        self._paths = [plan.components[i].path for i in self._seeds]
        self._order = _order(plan, tables)
        # Slots, minima and maxima of the native components' inputs that have limits.
        slots: list[int] = []
        low: list[float] = []
        high: list[float] = []
        for placed in tables.inputs.values():
            v = placed.variable
            native = tables.bindings[placed.member].kind == BindingKind.NATIVE
            if native and (v.min, v.max) != (None, None):
                slots += placed.slots
                low += [-np.inf if v.min is None else v.min] * v.size
                high += [np.inf if v.max is None else v.max] * v.size
        self._checked = np.array(slots, np.intp)
        self._low, self._high = np.array(low), np.array(high)

    def enter(self, states: Sequence[object], seed: int | None, start: Starts) -> None:
        """Go back to Initialization Mode, with the plan's start values, `start` and the seed.

        `states` are those in Initialization Mode; None for a component that cannot copy its state,
        or has been replaced since.
        """
        keys: dict[int, np.ndarray] = {}
        if seed is not None and self._seeds:
            keys = dict(zip(self._seeds, component_seeds([seed], self._paths)[0], strict=True))
        for i, state in enumerate(states):
            path = self._plan.components[i].path
            if state is None:
                planned, component = self._plan.components[i], self._components[i]
                if is_pooled(component):
                    component = self._components[i] = self._pools[i].exchange(component)
                    self._tables.replace(self._tables.order.index(i), component)
                else:
                    component.reset()
                enter_initialization(planned, component, start.get(path, {}), seed, self._times)
                continue
            component = self._components[i]
            # The state is in Initialization Mode, after the plan's start values were set: only the
            # values that differ in this run are set again.
            component.set_fmu_state(state)
            values = start.get(path, {})
            if i in keys and "seed" not in values:
                component.set(self._seeds[i], keys[i])
            for name, value in values.items():
                component.set(component.description.variables[name], value)

    def propagate(self, tick: int, time: float) -> Failure | None:
        """Set all inputs from their sources; return a failure of a component in C, or raise.

        This is done in C if it can be, and in Python otherwise.
        """
        if self._order is None:
            propagate(self._plan, self._components, time)
            return None
        self._tables.show_unconnected(self._components)
        failure = self._tables.core.propagate(tick, self._order)
        if failure is not None and failure.outcome == Outcome.BAD_STATUS:
            return failure
        values = self._tables.core.slots.view(np.float64)[self._checked]
        if failure is not None or not ((values >= self._low) & (values <= self._high)).all():
            # Python repeats it: it raises the error with its text, or accepts the values.
            propagate(self._plan, self._components, time)
        return None


def _order(plan: Plan, tables: Tables) -> ctypes.Array[ctypes.c_uint32] | None:
    """Return the members to be set by C, in order; None if Python has to take part."""
    in_c = (BindingKind.NATIVE, BindingKind.FMI2, BindingKind.FMI3)
    if any(b.kind not in in_c for b in tables.bindings) or any(
        len(entry) > 1 for entry in plan.initialization
    ):
        return None
    for placed in tables.inputs.values():
        bounds = (placed.variable.min, placed.variable.max)
        if bounds != (None, None) and not Type.of(placed.variable) <= Type.Float32:
            return None
    member_of = {i: member for member, i in enumerate(tables.order)}
    order = [member_of[i] for (i,) in plan.initialization] + list(range(len(tables.order)))
    return (ctypes.c_uint32 * len(order))(*order)
