"""Control loops of a plan and their delays: every Jacobi connection delays by one step."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from uuvsim_cosim.orchestrator.plan.graphs import cheapest_cycles
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Loop", "equal_components", "loop_delays", "loop_lines", "stacked_name"]


@dataclass(frozen=True)
class Loop:
    """A cycle through the system; similar numbered components are one, ``thruster_1 … 8``."""

    path: tuple[str, ...]
    delay: Fraction  # s

    def __str__(self) -> str:
        """Write the delay and the path."""
        return f"{float(self.delay) * 1e3:g} ms: {' → '.join((*self.path, self.path[0]))}"


def loop_delays(plan: Plan) -> list[Loop]:
    """Return the fastest loop through each component, the slowest of them first.

    The number of all loops can grow exponentially with the system. The fastest loop through a
    component is the delay after which its outputs act on itself. A hop costs the step of its
    source component, the longest one if it varies. Within a Gauss-Seidel group, a hop from an
    earlier to a later member costs nothing, unless the earlier one has the longer step.
    """
    paths = [c.path for c in plan.components]
    edges = {(t.source, t.target) for t in plan.transfers}
    neighbours: dict[str, set[str]] = {p: set() for p in paths}
    for a, b in edges:
        neighbours[paths[a]].add(f"> {paths[b]}")
        neighbours[paths[b]].add(f"< {paths[a]}")
    types = {c.path: f"{c.source.partition('?')[0]}/{c.step_ticks}" for c in plan.components}
    names = equal_components(types, neighbours)
    free: set[tuple[int, int]] = set()  # hops within a group that cost no step
    for group in plan.groups:
        if group.algorithm == "iterated":
            free.update((a, b) for a in group.members for b in group.members)
        if group.algorithm == "gauss-seidel":
            for i, a in enumerate(group.members):
                step = plan.components[a].step_ticks
                later = group.members[i + 1 :]
                free.update((a, b) for b in later if step <= plan.components[b].step_ticks)
    graph: dict[str, dict[str, int]] = {names[p]: {} for p in paths}
    for a, b in sorted(edges):
        cost = 0 if (a, b) in free else plan.longest_step(a)
        hops = graph[names[paths[a]]]
        hops[names[paths[b]]] = max(cost, hops.get(names[paths[b]], 0))
    loops = [Loop(tuple(cycle), ticks * plan.tick) for ticks, cycle in cheapest_cycles(graph)]
    return sorted(loops, key=lambda loop: (-loop.delay, loop.path))


def loop_lines(loops: list[Loop], most: int = 6) -> list[str]:
    """Return a line for each delay, the longest first: a short loop, and the number of others."""
    by_delay: dict[Fraction, list[Loop]] = {}
    for loop in loops:
        by_delay.setdefault(loop.delay, []).append(loop)
    lines = []
    for same in list(by_delay.values())[:most]:
        first = min(same, key=lambda loop: (len(loop.path), loop.path))
        more = f"  (and {len(same) - 1} more)" if len(same) > 1 else ""
        lines.append(f"{first}{more}")
    return lines


def equal_components(
    types: Mapping[str, str], neighbours: Mapping[str, set[str]]
) -> dict[str, str]:
    """Return the name of each path's stack: numbered paths of equal type and connections."""
    stacks: dict[tuple[str, str], list[str]] = {}
    for path, type_ in types.items():
        match = re.fullmatch(r"(.*?)_?(\d+)", path)
        if match:
            stacks.setdefault((match[1], type_), []).append(path)
    stems = {p: f"{stem}#" for (stem, _), ps in stacks.items() if len(ps) > 1 for p in ps}

    def around(path: str) -> frozenset[str]:
        return frozenset(n[:2] + stems.get(n[2:], n[2:]) for n in neighbours.get(path, set()))

    result = {p: p for p in types}
    for paths in stacks.values():
        same: dict[frozenset[str], list[str]] = {}
        for p in paths:
            same.setdefault(around(p), []).append(p)
        for members in same.values():
            if len(members) > 1:
                result.update(dict.fromkeys(members, stacked_name(members)))
    return result


def stacked_name(members: list[str]) -> str:
    """Write the name of a stack: its first and its last member."""
    return f"{members[0]} … {members[-1]}"
