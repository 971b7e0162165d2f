"""Directed graphs over hashable nodes: strongly connected components, and cycles."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping
from heapq import heappop, heappush
from typing import TypeVar

__all__ = ["cheapest_cycles", "shortest_cycle", "strongly_connected"]

Node = TypeVar("Node", bound=Hashable)
Tree = dict[Node, tuple[int, int, Node]]  # of a search: cost, hops, and the node before


def strongly_connected(graph: Mapping[Node, Iterable[Node]]) -> list[list[Node]]:
    """Return the strongly connected components, each after its successors (Tarjan 1972)."""
    index: dict[Node, int] = {}
    low: dict[Node, int] = {}
    stack: list[Node] = []
    on_stack: set[Node] = set()
    result: list[list[Node]] = []
    for root in graph:
        if root in index:
            continue
        work = [(root, iter(graph[root]))]
        index[root] = low[root] = len(index)
        stack.append(root)
        on_stack.add(root)
        while work:
            node, successors = work[-1]
            for following in successors:
                if following not in index:
                    index[following] = low[following] = len(index)
                    stack.append(following)
                    on_stack.add(following)
                    work.append((following, iter(graph.get(following, ()))))
                    break
                if following in on_stack:
                    low[node] = min(low[node], index[following])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == index[node]:  # the root of a component: the stack above is its
                    component = [stack.pop()]
                    while component[-1] != node:
                        component.append(stack.pop())
                    on_stack.difference_update(component)
                    result.append(component[::-1])
    return result


def cheapest_cycles(graph: Mapping[Node, Mapping[Node, int]]) -> list[tuple[int, list[Node]]]:
    """Return a cheapest cycle through each node that is on any cycle, with its cost; each once.

    Costs are not negative. Of equal costs, a cycle with fewer nodes is returned. A cycle begins at
    its first node in the order of the graph. Each is found by a search that goes no farther than
    the cheapest cycle known so far through its node, so that a large graph of small cycles takes
    time in proportion to its size. If a search reaches half of the nodes, and the graph without its
    node falls apart into halves or less, two more searches give the cheapest cycles through that
    node and each other one, and the pieces are then searched alone. So a ring of small cycles also
    takes time in proportion to its size.
    """
    order = {node: i for i, node in enumerate(graph)}
    best: dict[Node, tuple[float, int]] = dict.fromkeys(graph, (math.inf, 0))  # cost, nodes
    through: dict[Node, tuple[Node, Tree[Node], Tree[Node]]] = {}  # best cycles, not built yet
    found: dict[tuple[Node, ...], int] = {}

    def add(cycle: list[Node], cost: int) -> None:
        first = min(range(len(cycle)), key=lambda i: order[cycle[i]])
        found.setdefault(tuple(cycle[first:] + cycle[:first]), cost)
        for member in cycle:
            if (cost, len(cycle)) <= best[member]:
                best[member] = (cost, len(cycle))
                through.pop(member, None)

    def search(
        hops: Mapping[Node, Mapping[Node, int]], root: Node, limit: tuple[float, int] | None
    ) -> Tree[Node]:
        """Search from a root below a limit and until it is reached again, or everywhere."""
        tree: Tree[Node] = {}
        heap = [(0, 0, order[root], root)]
        while heap:
            cost, nodes, _, node = heappop(heap)
            if nodes and (node == root or tree[node][:2] < (cost, nodes)):
                if node == root and limit is not None:
                    break
                continue
            for following, hop in hops[node].items():
                new = (cost + hop, nodes + 1)
                if (limit is None or new < limit) and (
                    following not in tree or new < tree[following][:2]
                ):
                    tree[following] = (*new, node)
                    heappush(heap, (*new, order[following], following))
        return tree

    def walk(tree: Tree[Node], root: Node, node: Node) -> list[Node]:
        """Return the nodes of a search from its root to a node, without the latter."""
        nodes = [tree[node][2]]
        while nodes[-1] != root:
            nodes.append(tree[nodes[-1]][2])
        return nodes[::-1]

    final: set[Node] = set()
    pieces = strongly_connected(graph)
    while pieces:
        inside = set(pieces.pop())
        nodes = sorted(inside, key=order.__getitem__)
        after = {n: {m: c for m, c in graph[n].items() if m in inside} for n in nodes}
        before: dict[Node, dict[Node, int]] = {n: {} for n in nodes}
        for node, hops in after.items():
            for following, hop in hops.items():
                before[following][node] = hop
        searched: set[Node] = set()
        for root in nodes:
            # Cycles through a node are those through the next one if there is no other way between.
            alike = [n for n in before[root] if len(before[root]) == len(after[n]) == 1]
            alike += [n for n in after[root] if len(after[root]) == len(before[n]) == 1]
            if root in final or any(n in searched and best[root] <= best[n] for n in alike):
                continue
            searched.add(root)
            forward = search(after, root, best[root])
            if root in forward:
                add(walk(forward, root, root), forward[root][0])
            if 2 * len(forward) < len(nodes) or len(nodes) < 3:
                continue
            rest = strongly_connected(
                {n: [m for m in after[n] if m != root] for n in nodes if n != root}
            )
            if 2 * max(map(len, rest)) <= len(nodes):
                forward, backward = search(after, root, None), search(before, root, None)
                for n in inside - {root}:
                    both = forward[n][0] + backward[n][0], forward[n][1] + backward[n][1]
                    if both < best[n]:
                        best[n], through[n] = both, (root, forward, backward)
                final |= searched
                pieces += rest
                break
    for n in graph:
        if n in through:
            root, forward, backward = through[n]
            there, back = walk(forward, root, n), walk(backward, root, n)
            add([*there, n, *back[:0:-1]], forward[n][0] + backward[n][0])
    return [(cost, list(cycle)) for cycle, cost in found.items()]


def shortest_cycle(graph: Mapping[Node, Iterable[Node]], node: Node) -> list[Node]:
    """Return a shortest cycle through a node, from that node on; empty if there is none."""
    came_from: dict[Node, Node] = {}
    reached = [node]
    for here in reached:
        for following in graph[here]:
            if following == node:
                path = [here]
                while path[-1] != node:
                    path.append(came_from[path[-1]])
                return path[::-1]
            if following not in came_from:
                came_from[following] = here
                reached.append(following)
    return []
