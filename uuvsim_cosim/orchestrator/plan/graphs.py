"""Directed graphs over hashable nodes: strongly connected components, and simple cycles."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping
from typing import TypeVar

__all__ = ["shortest_cycle", "simple_cycles", "strongly_connected"]

Node = TypeVar("Node", bound=Hashable)


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
                    begin = stack.index(node)
                    result.append(stack[begin:])
                    on_stack.difference_update(stack[begin:])
                    del stack[begin:]
    return result


def simple_cycles(graph: Mapping[Node, Iterable[Node]], limit: int = 2000) -> list[list[Node]]:
    """Return the cycles that visit no node twice, each from its first node; at most `limit`."""
    place = {node: i for i, node in enumerate(graph)}
    member = {n: i for i, part in enumerate(strongly_connected(graph)) for n in part}
    found: list[list[Node]] = []
    for root in graph:
        path = [root]
        work = [iter(graph[root])]
        while work and len(found) < limit:
            for following in work[-1]:
                if following == root:
                    found.append(list(path))
                elif (
                    place[following] > place[root]
                    and member[following] == member[root]
                    and following not in path
                ):
                    path.append(following)
                    work.append(iter(graph[following]))
                    break
            else:
                work.pop()
                path.pop()
    return found


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
