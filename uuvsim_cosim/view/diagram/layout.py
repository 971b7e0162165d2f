"""Layout of boxes: columns from left to right along the flow, few crossings, straight lines.

Sugiyama's scheme: an order with few backward nets, layers by longest path, an order inside each
layer by barycentres, and heights by least squares (pool-adjacent-violators).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from uuvsim_cosim.view.diagram.graph import Box, Net, text_width

__all__ = ["HEAD", "ROW", "Layout", "Place", "laid_out"]

HEAD = 44.0  # height of a box above its ports, px
ROW = 18.0
_SPACE = 26.0
_SWEEPS = 12

Cell = tuple[str, int]  # a box (key, -1), or the passage of a net ("", number of the net)


@dataclass
class Place:
    """Where a box, or a passage of a net, lies."""

    column: int
    y: float
    width: float
    height: float


@dataclass
class Layout:
    """Places of boxes and of passages (net, column), and the columns' cells from the top."""

    boxes: dict[str, Place]
    passages: dict[tuple[int, int], Place]
    columns: list[list[Cell]]
    widths: list[float] = field(default_factory=list)

    def port_y(self, box: Box, port: str, *, output: bool) -> float:
        """Return the height of a port."""
        ports = box.outputs if output else box.inputs
        return self.boxes[box.key].y + HEAD + ROW * (ports.index(port) + 0.5)


def laid_out(boxes: Mapping[str, Box], nets: list[Net]) -> Layout:
    """Return the places of the boxes, and order their ports so that few nets cross."""
    layer = _layers(list(boxes), nets)
    count = max(layer.values(), default=0) + 1
    columns: list[list[Cell]] = [[] for _ in range(count)]
    places: dict[str, Place] = {}
    for key, box in boxes.items():
        columns[layer[key]].append((key, -1))
        ins = max((text_width(box.labels[f"< {p}"], 11.5) for p in box.inputs), default=0.0)
        outs = max((text_width(box.labels[f"> {p}"], 11.5) for p in box.outputs), default=0.0)
        rate = text_width(box.rate, 11) + 12
        head = max(text_width(box.title, 13.5, bold=True), text_width(box.subtitle, 11) + rate)
        width = max(head + 26.0, ins + outs + 34.0, 120.0)
        height = HEAD + ROW * max(len(box.inputs), len(box.outputs), 0) + 7.0
        places[key] = Place(layer[key], 0.0, width, height)
    passages: dict[tuple[int, int], Place] = {}
    for n, net in enumerate(nets):
        last = max((layer[t] for t, _ in net.targets), default=0)
        for column in range(layer[net.source[0]] + 1, last):
            columns[column].append(("", n))
            passages[n, column] = Place(column, 0.0, 0.0, 4.0)
    layout = Layout(places, passages, columns)
    layout.widths = [max((places[k].width for k, n in c if n < 0), default=0.0) for c in columns]
    # The pieces of nets between neighbouring columns: (left column, left cell, right cell).
    links: dict[tuple[int, Cell, Cell], None] = {}
    for n, net in enumerate(nets):
        for target, _ in net.targets:
            cell: Cell = (net.source[0], -1)
            for column in range(layer[net.source[0]], layer[target]):
                following: Cell = (target, -1) if column + 1 == layer[target] else ("", n)
                links[column, cell, following] = None
                cell = following
    _order(layout, list(links))
    # Heights depend on the order of ports and the other way round, so the two alternate.
    for _ in range(4):
        _heights(layout, boxes, nets)
        _sort_ports(layout, boxes, nets)
    _heights(layout, boxes, nets)
    top = min((p.y for p in (*places.values(), *passages.values())), default=0.0)
    for place in (*places.values(), *passages.values()):
        place.y -= top
    return layout


def _layers(keys: list[str], nets: list[Net]) -> dict[str, int]:
    declared = {k: i for i, k in enumerate(keys)}
    # The order of declaration shows the direction of flow that the author has in mind.
    edges = {
        (n.source[0], t): 4 if declared[n.source[0]] < declared[t] else 1
        for n in nets
        for t, _ in n.targets
        if n.source[0] != t
    }
    order = _few_backward(keys, edges)
    rank = {k: i for i, k in enumerate(order)}
    forward = [(a, b) for a, b in edges if rank[a] < rank[b]]
    layer = dict.fromkeys(keys, 0)
    for key in order:
        before = [layer[a] for a, b in forward if b == key]
        layer[key] = max(before, default=-1) + 1
    for key in reversed(order):  # a box without inputs stands just before those it feeds
        after = [layer[b] for a, b in forward if a == key]
        if after and not any(b == key for _, b in forward):
            layer[key] = min(after) - 1
    return layer


def _few_backward(keys: list[str], edges: Mapping[tuple[str, str], int]) -> list[str]:
    """Order nodes so that few edges lead backward: each moves to its best place until none does."""
    order = list(keys)
    for _ in range(20):
        moved = False
        for key in keys:
            rest = [k for k in order if k != key]
            cost = sum(w for (a, b), w in edges.items() if b == key)
            # At place 0, all edges to the node lead backward; each place to the right changes that.
            here = order.index(key)
            costs = [cost]
            for other in rest:
                cost += edges.get((key, other), 0) - edges.get((other, key), 0)
                costs.append(cost)
            best = min(costs)
            place = here if costs[here] == best else costs.index(best)
            if place != here:
                order = [*rest[:place], key, *rest[place:]]
                moved = True
        if not moved:
            break
    return order


def _order(layout: Layout, links: list[tuple[int, Cell, Cell]]) -> None:
    """Order the cells of each column by the mean place of their neighbours; keep the best."""
    best = [list(c) for c in layout.columns]
    fewest = _crossings(best, links)
    for sweep in range(_SWEEPS):
        rightward = sweep % 2 == 0
        span = range(len(layout.columns))
        for column in span if rightward else reversed(span):
            rank = {c: i for cells in layout.columns for i, c in enumerate(cells)}
            if rightward:
                near = [(b, rank[a]) for col, a, b in links if col == column - 1]
            else:
                near = [(a, rank[b]) for col, a, b in links if col == column]
            layout.columns[column].sort(
                key=lambda c: _mean([y for k, y in near if k == c], rank[c])
            )
        crossings = _crossings(layout.columns, links)
        if crossings < fewest:
            fewest, best = crossings, [list(c) for c in layout.columns]
    layout.columns[:] = best


def _mean(values: Iterable[float], default: float) -> float:
    listed = list(values)
    return sum(listed) / len(listed) if listed else default


def _crossings(columns: list[list[Cell]], links: list[tuple[int, Cell, Cell]]) -> int:
    count = 0
    for column in range(len(columns) - 1):
        left = {c: i for i, c in enumerate(columns[column])}
        right = {c: i for i, c in enumerate(columns[column + 1])}
        pairs = [(left[a], right[b]) for col, a, b in links if col == column]
        count += sum((a - c) * (b - d) < 0 for i, (a, b) in enumerate(pairs) for c, d in pairs[:i])
    return count


def _heights(layout: Layout, boxes: Mapping[str, Box], nets: list[Net]) -> None:
    """Move cells so that their nets run straight, in the order of their column."""
    for sweep in range(_SWEEPS):
        span = range(len(layout.columns))
        for column in span if sweep % 2 == 0 else reversed(span):
            wanted = _wanted(layout, boxes, nets, column)
            cells = layout.columns[column]
            offsets, total = [], 0.0
            for cell in cells:
                offsets.append(total)
                total += _place(layout, cell, column).height + (_SPACE if cell[1] < 0 else 9.0)
            goals = [
                _mean(wanted.get(cell, []), _place(layout, cell, column).y) - offset
                for cell, offset in zip(cells, offsets, strict=True)
            ]
            weights = [max(len(wanted.get(c, [])), 0.2) for c in cells]
            for cell, y, offset in zip(cells, _monotone(goals, weights), offsets, strict=True):
                _place(layout, cell, column).y = y + offset


def _place(layout: Layout, cell: Cell, column: int) -> Place:
    return layout.boxes[cell[0]] if cell[1] < 0 else layout.passages[cell[1], column]


def _wanted(
    layout: Layout, boxes: Mapping[str, Box], nets: list[Net], column: int
) -> dict[Cell, list[float]]:
    """Return for each cell of a column the heights that would make its nets straight."""
    wanted: dict[Cell, list[float]] = {}
    for n, net in enumerate(nets):
        source = boxes[net.source[0]]
        start = layout.boxes[source.key].column
        for key, port in net.targets:
            end = layout.boxes[key].column
            if end <= start:
                continue
            chain: list[tuple[Cell, int, float]] = [
                ((source.key, -1), start, _port_offset(source, net.source[1], output=True))
            ]
            chain += [(("", n), c, 2.0) for c in range(start + 1, end)]
            chain.append(((key, -1), end, _port_offset(boxes[key], port, output=False)))
            for (a, ca, oa), (b, cb, ob) in pairwise(chain):
                ya, yb = _place(layout, a, ca).y + oa, _place(layout, b, cb).y + ob
                # Passages have more weight: straight long nets have the fewest bends.
                weight = 1 + 3 * (a[1] >= 0) * (b[1] >= 0)
                if cb == column:
                    wanted.setdefault(b, []).extend([ya - ob] * weight)
                if ca == column:
                    wanted.setdefault(a, []).extend([yb - oa] * weight)
    return wanted


def _port_offset(box: Box, port: str, *, output: bool) -> float:
    ports = box.outputs if output else box.inputs
    return HEAD + ROW * (ports.index(port) + 0.5)


def _monotone(goals: list[float], weights: list[float]) -> list[float]:
    """Return the non-decreasing numbers nearest to the goals (pool adjacent violators)."""
    blocks: list[tuple[float, float, int]] = []
    for goal, weight in zip(goals, weights, strict=True):
        blocks.append((goal, weight, 1))
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (a, wa, na), (b, wb, nb) = blocks[-2], blocks[-1]
            blocks[-2:] = [((a * wa + b * wb) / (wa + wb), wa + wb, na + nb)]
    return [value for value, _, count in blocks for _ in range(count)]


def _sort_ports(layout: Layout, boxes: Mapping[str, Box], nets: list[Net]) -> None:
    bottom = max((p.y + p.height for p in layout.boxes.values()), default=0.0)
    ins: dict[tuple[str, str], list[float]] = {}
    outs: dict[tuple[str, str], list[float]] = {}
    for n, net in enumerate(nets):
        start = layout.boxes[net.source[0]].column
        for key, port in net.targets:
            end = layout.boxes[key].column
            forward = end > start
            near_out = layout.passages.get((n, start + 1)) or layout.boxes[key]
            near_in = layout.passages.get((n, end - 1)) or layout.boxes[net.source[0]]
            outs.setdefault(net.source, []).append(near_out.y if forward else bottom + 1)
            ins.setdefault((key, port), []).append(near_in.y if forward else bottom + 1)
    for box in boxes.values():
        box.inputs.sort(key=lambda p: _mean(ins.get((box.key, p), []), 0.0))
        box.outputs.sort(key=lambda p: _mean(outs.get((box.key, p), []), 0.0))
