"""Check that the actuators carry the net weights that a scenario gives to a hull during a run."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from uuvsim_cosim.errors import Problem
from uuvsim_cosim.orchestrator.plan.compared_figures import floats
from uuvsim_cosim.orchestrator.plan.net_weight import WEIGHT, net_weight_findings, with_values
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, Manipulation, Scenario
from uuvsim_cosim.orchestrator.values.values import Misfit, fit

__all__ = ["net_weight_of_scenario"]


def net_weight_of_scenario(scenario: Scenario, plan: Plan) -> list[Problem]:
    """Return a problem for each event after which actuators cannot carry a hull's net weight.

    An override or a bias ends; then the value before it holds again.
    """
    changes: list[tuple[float, str, float]] = []
    for e in scenario.events:
        if not isinstance(e, Change | Manipulation):
            continue
        path, _, name = e.variable.rpartition(".")
        for c in plan.components:
            if c.path != path or name not in WEIGHT or name not in c.description.variables:
                continue
            variable = c.description.variables[name]
            own = floats(c.start.get(name, variable.start))
            given: tuple[float, ...] = ()
            with suppress(Misfit):  # which `Played` refuses
                given = floats(fit(variable, e.value, units=c.description.units))
            if len(own) == len(given) == 1:
                bias = own[0] if isinstance(e, Manipulation) and e.kind == "bias" else 0.0
                changes.append((e.at, e.variable, given[0] + bias))
                if isinstance(e, Manipulation):
                    changes.append((e.until, e.variable, own[0]))
    values: dict[str, float] = {}
    found: dict[str, Problem] = {}
    for at, changed, value in sorted(changes, key=lambda change: change[0]):
        values[changed] = value
        for p in net_weight_findings(with_values(plan.components, values))[0]:
            if p.place == changed.rpartition(".")[0]:
                place = f"scenario {scenario.name!r}, {changed} = {value:g} at {at:g} s"
                found.setdefault(place, replace(p, place=place))
    return list(found.values())
