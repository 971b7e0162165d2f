"""Flattening of a system to its plan: nested systems become paths, connections transfers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.algebraic_loops import apply_loop_policy, iteration_obstacles
from uuvsim_cosim.orchestrator.plan.clocks import check_clocks
from uuvsim_cosim.orchestrator.plan.events import with_events
from uuvsim_cosim.orchestrator.plan.hull_checks import hull_warnings
from uuvsim_cosim.orchestrator.plan.initialization import initialization_order
from uuvsim_cosim.orchestrator.plan.net_weight import net_weight_findings
from uuvsim_cosim.orchestrator.plan.plan import Group, Plan, PlannedComponent, Transfer
from uuvsim_cosim.orchestrator.plan.seeds import component_seeds
from uuvsim_cosim.orchestrator.plan.variable_step import planned_variable_step
from uuvsim_cosim.orchestrator.plan.vehicle_match import or_forced, vehicle_mismatches
from uuvsim_cosim.orchestrator.system.elements import Loops, step_text
from uuvsim_cosim.orchestrator.system.resolve import described_by
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.values.endpoints import Endpoint, resolve_endpoint
from uuvsim_cosim.orchestrator.values.transformation import Numbers
from uuvsim_cosim.orchestrator.values.values import as_array, flat

__all__ = ["flatten", "plan_to_inspect"]


@dataclass(frozen=True)
class _Leaf:
    """One element of a variable of a component of the plan."""

    component: int
    variable: Variable
    element: int


_Link = tuple[_Leaf, _Leaf, float, float, Numbers]  # source, target, factor, offset, table
_Pair = tuple[int, int, str, str, float, float, Numbers]  # components, variables, transformation


def flatten(system: System, seed: int = 0, loops: Loops | None = None) -> Plan:
    """Return the plan of a `system`; each component's seed is derived from the system's `seed`.

    The plan lists the components, who steps when, and which value goes where (see `Master`).

    `loops` is the policy for algebraic loops, by default the system's own (`System.loops`).
    Raises SystemInvalid if the policy refuses a loop. It is raised too if a component is made for
    another vehicle than its hull, or if a vehicle's actuators cannot carry its net weight, unless
    the system allows it (`System.with_mismatches`).

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.orchestrator import flatten
    >>> plan = flatten(uuv.load("bluerov2_hold"), seed=7)
    >>> len(plan.components), float(plan.tick)  # [s]
    (13, 0.01)
    >>> [(c.path, c.step_ticks) for c in plan.components][:2]
    [('guidance', 1), ('controller', 1)]
    """
    flat_ = _Flat(system, seed)
    mixed = vehicle_mismatches(system.name, flat_.components)
    sinking, far = net_weight_findings(flat_.components)
    mixed += sinking
    if mixed and system.mismatches == "refuse":
        raise SystemInvalid(or_forced(mixed))
    every = flat_.transfers()
    transfers = tuple(t for t in every if t.source_variable.type != "Clock")
    plan = Plan(
        tick=system.base_step,
        components=tuple(flat_.components),
        transfers=transfers,
        groups=flat_.groups(),
        initialization=initialization_order(flat_.components, transfers),
        warnings=(
            *system.notes,
            *map(str, mixed),
            *far,
            *hull_warnings(flat_.components),
        ),
        loops=system.loops if loops is None else loops,
        start=Fraction(str(system.start_time)),
        clocks=tuple(t for t in every if t.source_variable.type == "Clock"),
    )
    plan = apply_loop_policy(plan, flat_.ungrouped)
    if system.events:
        plan = with_events(plan, varies=system.variable_step is not None)
    check_clocks(plan)
    if system.variable_step is None:
        return plan
    about = plan.tick, plan.components, plan.transfers, plan.groups
    return replace(plan, variable=planned_variable_step(system.variable_step, *about))


def plan_to_inspect(system: System) -> tuple[Plan, str]:
    """Return the plan of a system for display, and the reason if a run would refuse it."""
    try:
        return flatten(system), ""
    except SystemInvalid as refused:
        return flatten(system.with_mismatches("warn"), loops="delay"), str(refused)


class _Flat:
    """The components of a system and of its nested systems, numbered in depth-first order."""

    def __init__(self, system: System, seed: int) -> None:
        self.system = system
        self.seed = seed
        self.components: list[PlannedComponent] = []
        self._nested: dict[int, tuple[System, Mapping[str, System | None]]] = {}
        self.index: dict[str, int] = {}
        self.ungrouped: frozenset[int] = frozenset()
        problems: list[Problem] = []
        self._collect(system, "", problems)
        if not self.components:
            problems.append(Problem(system.name, "no components", "at least one"))
        if problems:
            raise SystemInvalid(problems)
        keys = component_seeds([seed], list(self.index))[0].tolist()
        for i, (component, key) in enumerate(zip(self.components, keys, strict=True)):
            own = component.start.get("seed")
            words = [] if own is None else flat(own)
            if not (len(words) == 2 and all(isinstance(w, int) for w in words)):
                words = key  # unless the user has set it
            self.components[i] = replace(component, seed=(words[0], words[1]))

    def _collect(self, system: System, prefix: str, problems: list[Problem]) -> None:
        for element in system.elements:
            path = prefix + element.name
            nested = system.nested_or_none(element.name)
            if nested is not None:
                self._collect(nested, f"{path}.", problems)
                continue
            step = Fraction(element.rate or system.base_step)
            ticks = step / self.system.base_step
            if ticks.denominator != 1:
                problems.append(
                    Problem(
                        path,
                        f"a communication step of {step_text(step)} s, which the tick of "
                        f"{step_text(self.system.base_step)} s does not divide",
                        f"a whole multiple of {step_text(self.system.base_step)} s",
                    )
                )
            assert isinstance(element.source, str)
            description = system.checked.descriptions[element.name]
            self.index[path] = len(self.components)
            self.components.append(
                PlannedComponent(
                    path=path,
                    source=described_by(element.source, system.base, element.start).text,
                    description=description,
                    start={
                        n: as_array(description.variables[n], v) for n, v in element.start.items()
                    },
                    step_ticks=int(ticks),
                )
            )

    def transfers(self) -> tuple[Transfer, ...]:
        """Return the transfers, one for each pair of variables, by pair of components."""
        found: dict[_Pair, tuple[list[_Leaf], list[_Leaf]]] = {}
        for a, b, factor, offset, table in self._links(self.system, ""):
            names = a.variable.name, b.variable.name
            key = (a.component, b.component, *names, factor, offset, table)
            sources, targets = found.setdefault(key, ([], []))
            sources.append(a)
            targets.append(b)
        order = {pair: i for i, pair in enumerate(dict.fromkeys(k[:2] for k in found))}
        return tuple(
            Transfer(
                source=key[0],
                source_variable=sources[0].variable,
                source_elements=tuple(leaf.element for leaf in sources),
                target=key[1],
                target_variable=targets[0].variable,
                target_elements=tuple(leaf.element for leaf in targets),
                factor=key[4],
                offset=key[5],
                table=key[6],
            )
            for key, (sources, targets) in sorted(found.items(), key=lambda kv: order[kv[0][:2]])
        )

    def _links(self, system: System, prefix: str) -> Iterator[_Link]:
        for wire in system.checked.wires:
            pairs = zip(wire.source.elements, wire.target.elements, wire.changes, strict=True)
            for i, j, (factor, offset) in pairs:
                for a in self._leaves(system, prefix, wire.source, i):
                    for b in self._leaves(system, prefix, wire.target, j):
                        yield a, b, factor, offset, wire.table
        for name, nested in self._nested_in(system).items():
            if nested is not None:
                yield from self._links(nested, f"{prefix}{name}.")

    def _nested_in(self, system: System) -> Mapping[str, System | None]:
        """Return the nested system of each element, None for a component."""
        if id(system) not in self._nested:  # the system is kept too, so no other has its id
            found = {e.name: system.nested_or_none(e.name) for e in system.elements}
            self._nested[id(system)] = system, found
        return self._nested[id(system)][1]

    def _leaves(
        self, system: System, prefix: str, point: Endpoint, element: int
    ) -> Iterator[_Leaf]:
        """Follow an element of a connector into nested systems, to the components behind it."""
        nested = self._nested_in(system)[point.element]
        if nested is None:
            component = self.index[prefix + point.element]
            description = self.components[component].description
            yield _Leaf(component, description.variables[point.variable.name], element)
            return
        whole = point.variable.name
        single = point.variable.element_name(element)
        for item in nested.exposed:
            if item.name in (whole, single):
                inner = resolve_endpoint(item.path, nested.checked.descriptions)
                place = inner.elements[element if item.name == whole else 0]
                yield from self._leaves(nested, f"{prefix}{point.element}.", inner, place)

    def groups(self) -> tuple[Group, ...]:
        """Return a Jacobi group of the components that no group names, then the others."""
        explicit = list(self._explicit(self.system, ""))
        problems: list[Problem] = []
        for group in explicit:
            if group.algorithm == "iterated":
                members = [self.components[i] for i in group.members]
                place = f"iterated group of {', '.join(c.path for c in members)}"
                reasons = iteration_obstacles(members, self.system.base_step)
                problems += [Problem(place, read, expected) for read, expected in reasons]
        if problems:
            raise SystemInvalid(problems)
        grouped = {i for g in explicit for i in g.members}
        rest = tuple(i for i in range(len(self.components)) if i not in grouped)
        self.ungrouped = frozenset(rest)
        return (*((Group("jacobi", rest),) if rest else ()), *explicit)

    def _explicit(self, system: System, prefix: str) -> Iterator[Group]:
        """Yield the user's groups, and those of nested systems that no outer group contains."""
        grouped: set[str] = set()
        for group in system.groups:
            members: list[int] = []
            for name in group.members:
                path = prefix + name
                if system.nested_or_none(name) is None:
                    members.append(self.index[path])
                else:
                    members += [i for p, i in self.index.items() if p.startswith(f"{path}.")]
            grouped.update(group.members)
            yield Group(group.algorithm, tuple(members), group.solver, group.tolerance, group.limit)
        for element in system.elements:
            nested = system.nested_or_none(element.name)
            if nested is not None and element.name not in grouped:
                yield from self._explicit(nested, f"{prefix}{element.name}.")
