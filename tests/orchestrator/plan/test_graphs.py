"""Cycles of directed graphs: against a search of all paths, and in large graphs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.orchestrator.plan import graphs as graphs_of_plans
from uuvsim_cosim.orchestrator.plan.graphs import cheapest_cycles

Graph = dict[int, dict[int, int]]


def all_cycles(graph: Graph, path: list[int]) -> Iterator[tuple[int, list[int]]]:
    """Yield the cost and the nodes of each cycle that continues a path and ends at its begin."""
    for following in graph[path[-1]]:
        if following == path[0]:
            hops = zip(path, [*path[1:], path[0]], strict=True)
            yield sum(graph[a][b] for a, b in hops), path
        elif following not in path:
            yield from all_cycles(graph, [*path, following])


@st.composite
def graphs(draw: st.DrawFn) -> Graph:
    n = draw(st.integers(1, 8))
    hop = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1), st.integers(0, 3))
    graph: Graph = {i: {} for i in draw(st.permutations(range(n)))}
    for a, b, cost in draw(st.lists(hop, max_size=18)):
        graph[a][b] = cost
    return graph


@given(graphs())
def test_the_cheapest_cycle_through_each_node_is_found(graph: Graph) -> None:
    found = cheapest_cycles(graph)
    for cost, cycle in found:
        assert cost == sum(graph[a][b] for a, b in zip(cycle, [*cycle[1:], cycle[0]], strict=True))
    assert len({tuple(cycle) for _, cycle in found}) == len(found) <= len(graph)
    for node in graph:
        expected = min((cost for cost, _ in all_cycles(graph, [node])), default=None)
        assert min((c for c, cycle in found if node in cycle), default=None) == expected


def test_a_ring_of_meshes_has_no_more_cycles_than_nodes() -> None:
    # 40 layers of 5 nodes, each connected with all of the next layer: 5 ** 40 cycles around.
    graph = {
        (layer, i): {((layer + 1) % 40, j): 1 for j in range(5)}
        for layer in range(40)
        for i in range(5)
    }
    found = cheapest_cycles(graph)
    assert {cost for cost, _ in found} == {40}
    assert {node for _, cycle in found for node in cycle} == set(graph)


def test_the_search_of_a_ring_of_small_cycles_grows_with_its_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Each block is a loop of 5 nodes, which one more node connects with the block before it.
    visits = []
    push = graphs_of_plans.heappush
    monkeypatch.setattr(graphs_of_plans, "heappush", lambda h, n: (visits.append(n), push(h, n)))

    def ring(k: int) -> int:
        graph: Graph = {i: {} for i in range(6 * k)}
        for first in range(0, 6 * k, 6):
            for i in range(5):
                graph[first + i][first + (i + 1) % 5] = 1
            graph[(first - 6) % (6 * k) + 3][first + 5] = 1
            graph[first + 5][first] = 1
        visits.clear()
        found = cheapest_cycles(graph)
        assert sorted({cost for cost, _ in found}) == [5, 5 * k]
        assert len(found) == k + 1
        return len(visits)

    assert ring(200) < 1.1 * 10 * ring(20)
