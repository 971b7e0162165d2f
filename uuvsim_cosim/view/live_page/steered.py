"""Parts of a system that a page can command: waypoints, and the components that a person steers.

The components are those that `bridge.http.keyboard` replaces by a person, and a wrench input. A
page leaves the components in place, and overrides their signals or sets their inputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent

__all__ = ["Steered", "path_names", "steered_parts"]

_POSE, _RATES = ("eta_d", "nu_d"), ("a", "omega")


@dataclass(frozen=True)
class Steered:
    """A component, or for a wrench an input, that the axes of a page move.

    `eta` and `nu` are the outputs from which the component has its estimate; "" if it has none.
    """

    kind: Literal["guidance", "pilot", "helm", "wrench"]
    path: str
    eta: str = ""
    nu: str = ""


def steered_parts(plan: Plan) -> list[Steered]:
    """Return what a person can steer, the most useful first."""
    order = ("guidance", "pilot", "helm", "wrench")
    return sorted(_found(plan), key=lambda s: order.index(s.kind))


def _found(plan: Plan) -> Iterator[Steered]:
    for i, c in enumerate(plan.components):
        outputs = {v.name for v in c.description.of("output")}
        eta, nu = (_source(plan, i, name) for name in ("eta", "nu"))
        if outputs.issuperset(_POSE) and eta:
            yield Steered("guidance", c.path, eta, nu)
        elif outputs.issuperset(_RATES) and nu:
            yield Steered("helm", c.path, eta, nu)
        elif "nu_d" in outputs and all(_is_free(plan, i, c, name, 1) for name in _RATES):
            yield Steered("pilot", c.path)
        if _is_free(plan, i, c, "tau_d", 6):
            yield Steered("wrench", f"{c.path}.tau_d")


def _is_free(plan: Plan, i: int, c: PlannedComponent, name: str, size: int) -> bool:
    """Return whether a component has an input of this size without any connection."""
    v = c.description.variables.get(name)
    fits = v is not None and v.causality == "input" and v.size == size
    return fits and (i, name) not in plan.connected


def _source(plan: Plan, i: int, name: str) -> str:
    """Return the output of 6 elements that feeds a whole input, "hull.eta", or ""."""
    for t in plan.to_component.get(i, ()):
        whole = t.source_elements == t.target_elements == tuple(range(6))
        if t.target_variable.name == name and whole:
            return f"{plan.components[t.source].path}.{t.source_variable.name}"
    return ""


def path_names(plan: Plan) -> dict[str, str] | None:
    """Return the parameters of the guidance that follows waypoints: table and number of rows."""
    for c in plan.components:
        table, count = (c.description.variables.get(n) for n in ("waypoints", "count"))
        if table is None or table.causality != "parameter" or table.variability != "tunable":
            continue
        if len(table.shape) == 2 and table.shape[1] == 3:
            tunable = count is not None and count.variability == "tunable"
            return {
                "table": f"{c.path}.waypoints",
                "count": f"{c.path}.count" if tunable else "",
            }
    return None
