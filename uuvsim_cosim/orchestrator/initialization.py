"""The order in which outputs become known in Initialization Mode, and the loops on the way.

Nodes are outputs, and for each component the event that all its inputs are set. An output
waits for the inputs that it declares to depend on; one that declares nothing waits for all.
"""

from __future__ import annotations

from collections.abc import Sequence

from uuvsim_cosim.orchestrator.graphs import simple_cycles, strongly_connected
from uuvsim_cosim.orchestrator.plan import PlannedComponent, Transfer

__all__ = ["initialization_order"]

_Output = tuple[int, str]  # component, output; "" is the event that all inputs are set


def initialization_order(
    components: Sequence[PlannedComponent], transfers: Sequence[Transfer]
) -> tuple[tuple[tuple[int, ...], ...], tuple[str, ...]]:
    """Give the entries of `Plan.initialization`, and a warning for each loop.

    A component comes again when more of its inputs have become known, and last when all are.
    """
    waits = _waits(components, transfers)
    entries: list[tuple[int, ...]] = []
    warnings: list[str] = []
    blocks = strongly_connected(waits)
    for block in _contiguous(blocks, waits):
        if len(block) == 1 and block[0] not in waits[block[0]]:
            entry = (block[0][0],)
            if not entries or entries[-1] != entry:
                entries.append(entry)
            continue
        members = tuple(sorted({c for c, _ in block}))
        entries.append(members if len(members) > 1 else members * 2)
        inside = {n: [w for w in waits[n] if w in block] for n in block}
        warnings.append(_warning(inside, components, transfers))
    return tuple(entries), tuple(warnings)


def _waits(
    components: Sequence[PlannedComponent], transfers: Sequence[Transfer]
) -> dict[_Output, list[_Output]]:
    feeds: dict[int, dict[str, list[_Output]]] = {}
    used: dict[_Output, None] = {}
    for t in transfers:
        output = (t.source, t.source_variable.name)
        feeds.setdefault(t.target, {}).setdefault(t.target_variable.name, []).append(output)
        used[output] = None
    waits: dict[_Output, list[_Output]] = {}
    for output in used:
        component, name = output
        inputs = feeds.get(component, {})
        declared = components[component].description.variables[name].dependencies
        names = inputs if declared is None else [n for n in declared if n in inputs]
        waits[output] = list(dict.fromkeys(o for n in names for o in inputs[n]))
    for i in range(len(components)):
        every = (o for found in feeds.get(i, {}).values() for o in found)
        waits[i, ""] = list(dict.fromkeys(every))
    return waits


def _contiguous(
    blocks: list[list[_Output]], waits: dict[_Output, list[_Output]]
) -> list[list[_Output]]:
    """Order blocks so that each comes after what it waits for, and one component's together."""
    home = {node: i for i, block in enumerate(blocks) for node in block}
    missing = [
        {home[w] for node in block for w in waits[node]} - {i} for i, block in enumerate(blocks)
    ]
    left = list(range(len(blocks)))
    done: set[int] = set()
    result: list[list[_Output]] = []
    last: int | None = None
    while left:
        ready = [i for i in left if missing[i] <= done]
        same = [i for i in ready if blocks[i][0][0] == last]
        early = [i for i in ready if blocks[i][0][1] != ""]
        chosen = (same or early or ready)[0]
        last = blocks[chosen][0][0]
        result.append(blocks[chosen])
        done.add(chosen)
        left.remove(chosen)
    return result


def _warning(
    inside: dict[_Output, list[_Output]],
    components: Sequence[PlannedComponent],
    transfers: Sequence[Transfer],
) -> str:
    loop = simple_cycles(inside, limit=1)[0][::-1]  # waiting runs against the flow
    hops: list[str] = []
    undeclared: list[str] = []
    for (a, out), (b, following) in zip(loop, loop[1:] + loop[:1], strict=True):
        variable = components[b].description.variables[following]
        into = next(
            t.target_variable.name
            for t in transfers
            if (t.source, t.source_variable.name, t.target) == (a, out, b)
            and (variable.dependencies is None or t.target_variable.name in variable.dependencies)
        )
        hops.append(f"{components[a].path}.{out} -> {components[b].path}.{into}")
        if variable.dependencies is None:
            undeclared.append(f"{components[b].path}.{into} -> {components[b].path}.{following}")
    path = ", ".join(hops)
    if not undeclared:
        return (
            "algebraic loop, solved in initialization; in stepping each connection delays by a "
            f"step, unless an iterated group solves it: {path}"
        )
    return (
        f"loop in initialization, iterated because feedthrough is not declared "
        f"({', '.join(undeclared)}): {path}"
    )
