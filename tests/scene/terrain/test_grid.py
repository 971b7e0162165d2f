"""A piece of a terrain: it has at least two nodes each way, wherever it lies."""

from __future__ import annotations

import pytest

from uuvsim_cosim.scene.terrain.grid import _at_least_two


@pytest.mark.parametrize(
    ("first", "last", "kept"),
    [(1, 3, (1, 4)), (2, 2, (2, 4)), (0, 0, (0, 2)), (4, 4, (3, 5)), (0, 4, (0, 5))],
)
def test_a_piece_has_at_least_two_nodes_each_way(
    first: int, last: int, kept: tuple[int, int]
) -> None:
    assert _at_least_two(first, last, 5) == slice(*kept)
