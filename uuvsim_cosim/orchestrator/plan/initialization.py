"""Order in which outputs become known in Initialization Mode.

The graph's nodes are outputs and, for each component, the event that all its inputs are set. An
output waits for the inputs in its declared dependencies; without a declaration, for all inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heappop, heappush

from uuvsim_cosim.orchestrator.plan.graphs import strongly_connected
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent, Transfer

__all__ = ["Output", "initialization_order", "waits_of"]

Output = tuple[int, str]  # component, output; "" is the event that all inputs are set


def initialization_order(
    components: Sequence[PlannedComponent], transfers: Sequence[Transfer]
) -> tuple[tuple[int, ...], ...]:
    """Return the entries of `Plan.initialization`.

    A component has several entries if its outputs become known at different times: one whenever
    more of its inputs are known, and the last when all are.
    """
    waits = waits_of(components, transfers)
    entries: list[tuple[int, ...]] = []
    for block in _ordered(strongly_connected(waits), waits):
        if len(block) == 1 and block[0] not in waits[block[0]]:
            entry = (block[0][0],)
            if not entries or entries[-1] != entry:
                entries.append(entry)
            continue
        members = tuple(sorted({c for c, _ in block}))
        # A loop within one component is marked as a loop by naming it twice.
        entries.append(members if len(members) > 1 else members * 2)
    return tuple(entries)


def waits_of(
    components: Sequence[PlannedComponent],
    transfers: Sequence[Transfer],
    *,
    declared_only: bool = False,
) -> dict[Output, list[Output]]:
    """Return the outputs that each connected output waits for, through inputs and connections.

    With `declared_only`, an output that declares no dependencies waits for nothing.
    """
    feeds: dict[int, dict[str, list[Output]]] = {}
    used: dict[Output, None] = {}
    for t in transfers:
        output = (t.source, t.source_variable.name)
        feeds.setdefault(t.target, {}).setdefault(t.target_variable.name, []).append(output)
        used[output] = None
    waits: dict[Output, list[Output]] = {}
    for output in used:
        component, name = output
        inputs = feeds.get(component, {})
        declared = components[component].description.variables[name].dependencies
        if declared is None:
            names = [] if declared_only else [*inputs]
        else:
            names = [n for n in declared if n in inputs]
        waits[output] = list(dict.fromkeys(o for n in names for o in inputs[n]))
    for i in range(len(components)):
        every = (o for found in feeds.get(i, {}).values() for o in found)
        waits[i, ""] = list(dict.fromkeys(every))
    return waits


def _ordered(blocks: list[list[Output]], waits: dict[Output, list[Output]]) -> list[list[Output]]:
    """Order blocks: each after those that it waits for, and those of a component in sequence.

    Fewer changes of the component mean fewer entries of the plan.
    """
    home = {node: i for i, block in enumerate(blocks) for node in block}
    followers: list[set[int]] = [set() for _ in blocks]
    missing = [0] * len(blocks)
    for i, block in enumerate(blocks):
        for before in {home[w] for node in block for w in waits[node]} - {i}:
            followers[before].add(i)
            missing[i] += 1
    # Blocks that wait for nothing more, the first one on top: all, those of outputs, and those of
    # each component. Blocks that are done stay in the other heaps until they come to the top.
    ready: list[int] = []
    outputs: list[int] = []
    of_component: dict[int, list[int]] = {}
    done = [False] * len(blocks)

    def add(i: int) -> None:
        component, name = blocks[i][0]
        heappush(ready, i)
        heappush(of_component.setdefault(component, []), i)
        if name:
            heappush(outputs, i)

    for i, count in enumerate(missing):
        if not count:
            add(i)
    result: list[list[Output]] = []
    last: list[int] = []  # ready blocks of the component of the last block
    while len(result) < len(blocks):
        for heap in (last, outputs, ready):
            while heap and done[heap[0]]:
                heappop(heap)
        chosen = (last or outputs or ready)[0]
        done[chosen] = True
        result.append(blocks[chosen])
        for i in followers[chosen]:
            missing[i] -= 1
            if not missing[i]:
                add(i)
        last = of_component[blocks[chosen][0][0]]
    return result
