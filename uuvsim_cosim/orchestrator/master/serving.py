"""Child process of an isolated component: a loop in C steps it on the parent's request."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import final

from uuvsim_cosim.errors import FmuError, UuvsimError
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.master.core_library import library
from uuvsim_cosim.orchestrator.master.core_tables import Tables, tables_of
from uuvsim_cosim.orchestrator.master.failure import error_of
from uuvsim_cosim.orchestrator.master.shared import text_capacity
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent

__all__ = ["Serving", "serve"]


@final
class Serving:
    """Component with its own tables, whose slots another process fills and reads."""

    def __init__(
        self, component: Component, tables: Tables, segment: int, pipe: int, spins: int
    ) -> None:
        self._c = library()
        self._component, self._tables, self._pipe = component, tables, pipe
        self._messages = getattr(component, "waiting_messages", None)  # an address
        read = [[p.variable for p in side.values()] for side in (tables.inputs, tables.outputs)]
        sizes = [sum(v.size for v in variables) for variables in read]
        self._exchange = self._c.uuv_exchange_new()
        capacity = text_capacity([*read[0], *read[1]])
        if not self._exchange or not self._c.uuv_exchange_map(
            self._exchange, segment, *sizes, capacity
        ):
            raise UuvsimError(f"{component.path}: its shared memory cannot be mapped")
        self._c.uuv_exchange_waits(self._exchange, 0, 0.0, spins)

    def run(self) -> None:
        """Step on request, until the parent writes to the pipe or ends."""
        self._tables.core.serve(self._exchange, self._pipe, self._messages)

    def forget(self) -> None:
        """Set every input at the next step, also those that have not changed."""
        self._tables.forget_inputs()

    def error(self, time: float) -> BaseException:
        """Return the error of the last step."""
        return error_of(self._tables.core.why(), self._tables, [self._component], time)

    def close(self) -> None:
        """Free the tables; only while the component still exists."""
        self._tables.core.forget()
        self._tables.core.free()
        self._c.uuv_exchange_free(self._exchange)


def serve(
    component: Component,
    segment: int,
    pipe: int,
    inputs: Sequence[str],
    outputs: Sequence[str],
    spins: int,
) -> Serving:
    """Prepare stepping of a component through the memory `segment`; called in its process."""
    variables = component.description.variables
    planned = PlannedComponent(component.path, "", component.description)
    held, live = ([(0, variables[n]) for n in names] for names in (inputs, outputs))

    def serving(group: Group) -> Serving:  # its plan has this component only
        plan = Plan(Fraction(1), (planned,), (), (group,), ((0,),))
        tables = tables_of(plan, [component], (), live=live, held=held)
        return Serving(component, tables, segment, pipe, spins)

    if component.description.can_get_and_set_state:  # then the parent may iterate it
        try:
            return serving(Group("iterated", (0,)))
        except FmuError:
            pass  # its description declares states, but its binary has no functions for them
    return serving(Group("jacobi", (0,)))
