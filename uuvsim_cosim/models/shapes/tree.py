"""Bounding-box tree over the parts of a scene, for fmus/runtime/worlds/uuv_tree.h.

It is split where the surface area heuristic is least (Wald 2007, On fast Construction of SAH-based
Bounding Volume Hierarchies: 16 bins along the longest axis), all nodes of a level at once, and two
levels become one of nodes with four children. Results of the caster do not depend on its shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DEPTH", "NOBODY", "Tree", "tree_of"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
NOBODY = -(2**31)  # a child that is not there: UUV_TREE_NOBODY
DEPTH = 26  # levels of nodes at most, for UUV_TREE_STACK
BINS = 16
_HALVED = 20  # levels of two after which nodes are halved by number, which bounds the depth


@dataclass(frozen=True, eq=False)
class Tree:
    """Nodes of four children, the root first; a child is a node, or -1 - the number of a part."""

    boxes: NDArray[np.float32]  # (nodes, 6, 4) m: least N, E, D, then greatest
    children: NDArray[np.int32]  # (nodes, 4)


def tree_of(low: Array, high: Array) -> Tree:
    """Build the tree over n boxes (n, 3) [m], rounded outwards to float32."""
    least, most = _outwards(low, -np.inf), _outwards(high, np.inf)
    n = len(low)
    if n == 0:
        return Tree(np.zeros((0, 6, 4), np.float32), np.zeros((0, 4), np.int32))
    return _joined_by_four(least, most, _split(least.astype(float), most.astype(float)))


def _outwards(values: Array, towards: float) -> NDArray[np.float32]:
    rounded = values.astype(np.float32)
    wrong = rounded > values if towards < 0 else rounded < values
    return np.where(wrong, np.nextafter(rounded, np.float32(towards)), rounded)


def _split(low: Array, high: Array) -> Ints:
    """Return the two children of each inner node (m, 2): a node, or -1 - part; the root is 0."""
    n = len(low)
    order = np.arange(n)
    pairs = np.full((max(1, n - 1), 2), -1, np.int64)
    if n == 1:
        return np.array([[-1, NOBODY]])
    start, count, node, made, level = np.array([0]), np.array([n]), np.array([0]), 1, 0
    while len(start):
        # the parts of the nodes that are still to be split, node by node
        run = np.repeat(np.arange(len(start)), count)
        places = np.repeat(start - np.cumsum(count) + count, count) + np.arange(len(run))
        in_first = _sorted(low, high, order, places, run, count, level)
        level += 1
        firsts, counts = (
            np.stack(pair, 1).ravel()
            for pair in ((start, start + in_first), (in_first, count - in_first))
        )
        alone = counts == 1
        children = np.where(alone, -1 - order[firsts], 0)
        children[~alone] = made + np.arange((~alone).sum())
        pairs[node] = children.reshape(-1, 2)
        start, count, node = firsts[~alone], counts[~alone], children[~alone]
        made += len(node)
    return pairs


def _sorted(
    low: Array, high: Array, order: Ints, places: Ints, run: Ints, count: Ints, level: int
) -> Ints:
    """Sort the parts of each node along its longest axis; return how many go to its first child."""
    parts = order[places]
    first = np.cumsum(count) - count
    centre = 0.5 * (low[parts] + high[parts])
    least, most = np.minimum.reduceat(centre, first), np.maximum.reduceat(centre, first)
    axis = np.argmax(most - least, axis=1)
    rows = np.arange(len(count))
    along = centre[np.arange(len(parts)), axis[run]]
    if level >= _HALVED:
        order[places] = parts[np.lexsort((along, run))]
        return count // 2
    begin, extent = least[rows, axis], (most - least)[rows, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.where(extent[run] > 0, (along - begin[run]) / extent[run], 0.0) * BINS
    bins = run * BINS + np.minimum(scaled.astype(np.int64), BINS - 1)
    sort = np.argsort(bins, kind="stable")
    order[places] = parts[sort]
    counts = np.bincount(bins, minlength=BINS * len(count))
    filled = np.flatnonzero(counts)
    starts = (np.cumsum(counts) - counts)[filled]
    in_bins = np.full((2, BINS * len(count), 3), np.inf)
    in_bins[0, filled] = np.minimum.reduceat(low[parts][sort], starts)
    in_bins[1, filled] = np.minimum.reduceat(-high[parts][sort], starts)
    boxes = in_bins.reshape(2, -1, BINS, 3)
    counts = counts.reshape(-1, BINS)
    before, after = np.cumsum(counts, 1), np.cumsum(counts[:, ::-1], 1)[:, ::-1]
    with np.errstate(invalid="ignore"):
        cost = before[:, :-1] * _area(np.minimum.accumulate(boxes, 2))[:, :-1]
        cost += after[:, 1:] * _area(np.minimum.accumulate(boxes[:, :, ::-1], 2))[:, :0:-1]
    cost[(before[:, :-1] == 0) | (after[:, 1:] == 0)] = np.inf
    cut = np.argmin(cost, axis=1)
    return np.where(np.isfinite(cost[rows, cut]), before[rows, cut], count // 2)


def _area(boxes: Array) -> Array:
    """Return half the surface of boxes (2, ..., 3): least corners, and minus the greatest."""
    x, y, z = np.moveaxis(-boxes[1] - boxes[0], -1, 0)
    return np.asarray(x * y + y * z + z * x)


def _joined_by_four(low: NDArray[np.float32], high: NDArray[np.float32], pairs: Ints) -> Tree:
    """Take each second level out: the children of a node are those of its two children."""
    frontier, levels, given = np.array([0]), [], 0
    while len(frontier):
        two = pairs[frontier]
        inner = two >= 0
        below = pairs[np.where(inner, two, 0)]
        four = np.where(inner[:, :, None], below, np.stack([two, np.full_like(two, NOBODY)], 2))
        four = four.reshape(-1, 4)
        frontier = four[four >= 0]
        given += len(four)
        four[four >= 0] = given + np.arange(len(frontier))
        levels.append(four)
    assert len(levels) <= DEPTH, f"{len(levels)} levels"
    children = np.concatenate(levels).astype(np.int32)
    boxes = np.empty((len(children), 6, 4), np.float32)
    end = len(children)
    for four in reversed(levels):  # from the parts up
        begin = end - len(four)
        boxes[begin:end] = node_boxes(four, low, high, boxes)
        end = begin
    return Tree(boxes, children)


def node_boxes(
    children: Ints, low: NDArray[np.float32], high: NDArray[np.float32],
    nodes: NDArray[np.float32],
) -> NDArray[np.float32]:  # fmt: skip
    """Return the boxes (m, 6, 4) of children (m, 4), of parts or of nodes whose boxes are known."""
    part = np.where((children < 0) & (children != NOBODY), -1 - children, 0)
    boxes = np.concatenate([low[part], high[part]], axis=2)
    inner = children >= 0
    below = nodes[children[inner]]
    boxes[inner] = np.concatenate([below[:, :3].min(axis=2), below[:, 3:].max(axis=2)], axis=1)
    most = np.finfo(np.float32).max
    boxes[children == NOBODY] = np.array([most] * 3 + [-most] * 3, np.float32)
    return boxes.transpose(0, 2, 1)
