"""Routing of nets: a trunk in each gap between columns, a channel below for backward nets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from uuvsim_cosim.view.diagram.graph import Box, Net
from uuvsim_cosim.view.diagram.layout import Layout

__all__ = ["Point", "Routed", "routed"]

TRACK = 9.0  # px between trunks
_EDGE = 16.0  # between a box and the first trunk
_CHANNEL = 11.0

Point = tuple[float, float]


@dataclass(frozen=True)
class Routed:
    """The left edge of each column, one polyline for each (net, target), and the extent."""

    columns: list[float]
    lines: list[tuple[int, list[Point]]]
    width: float
    height: float


@dataclass
class _Trunk:
    """The vertical piece of a net in a gap, with the heights of its entry and exits."""

    entry: float
    exits: list[float]
    track: int = 0

    @property
    def low(self) -> float:
        return min(self.entry, *self.exits)

    @property
    def high(self) -> float:
        return max(self.entry, *self.exits)


def routed(layout: Layout, boxes: Mapping[str, Box], nets: list[Net]) -> Routed:
    """Route every net. Gap g lies left of column g."""
    places = [*layout.boxes.values(), *layout.passages.values()]
    bottom = max((p.y + p.height for p in places), default=0.0)
    column = {key: place.column for key, place in layout.boxes.items()}
    spans: dict[int, int] = {}  # columns of a backward net, which passes below the boxes
    for n, net in enumerate(nets):
        start = column[net.source[0]]
        back = [start - column[t] for t, _ in net.targets if column[t] <= start]
        if back:
            spans[n] = max(back)
    order = sorted(spans, key=lambda n: (spans[n], n))  # short ones lie above long ones
    channels = {n: bottom + 20.0 + _CHANNEL * i for i, n in enumerate(order)}
    trunks: list[dict[int, _Trunk]] = [{} for _ in range(len(layout.columns) + 1)]

    def join(gap: int, net: int, entry: float, out: float) -> None:
        trunk = trunks[gap].setdefault(net, _Trunk(entry, []))
        trunk.exits.append(out)

    for n, net in enumerate(nets):
        start = column[net.source[0]]
        y = layout.port_y(boxes[net.source[0]], net.source[1], output=True)
        for key, port in net.targets:
            end, y_end = column[key], layout.port_y(boxes[key], port, output=False)
            if end > start:
                before = y
                for gap in range(start + 1, end):
                    after = layout.passages[n, gap].y + 2.0
                    join(gap, n, before, after)
                    before = after
                join(end, n, before, y_end)
            else:
                join(start + 1, n, y, channels[n])
                join(end, -n - 1, channels[n], y_end)
    for found in trunks:
        _assign(found)
    lefts, x = [], 0.0
    gaps: list[float] = []
    for gap, found in enumerate(trunks):
        gaps.append(x)
        tracks = max((t.track + 1 for t in found.values()), default=0)
        edge = gap in (0, len(trunks) - 1)
        x += 0.0 if edge and not tracks else 2 * _EDGE + TRACK * max(tracks - 1, 0)
        if gap < len(layout.columns):
            lefts.append(x)
            x += layout.widths[gap]
    drawn = _Drawing(layout, boxes, lefts, gaps, trunks)
    lines = [(n, drawn.line(n, net, target, channels)) for n, net in enumerate(nets)
             for target in net.targets]  # fmt: skip
    height = max([bottom, *channels.values()])
    return Routed(lefts, lines, x, height)


@dataclass
class _Drawing:
    layout: Layout
    boxes: Mapping[str, Box]
    lefts: list[float]
    gaps: list[float]
    trunks: list[dict[int, _Trunk]]

    def line(
        self, n: int, net: Net, target: tuple[str, str], channels: Mapping[int, float]
    ) -> list[Point]:
        layout = self.layout
        source, (key, port) = self.boxes[net.source[0]], target
        start, end = layout.boxes[source.key].column, layout.boxes[key].column
        y = layout.port_y(source, net.source[1], output=True)
        y_end = layout.port_y(self.boxes[key], port, output=False)
        points = [(self.lefts[start] + layout.boxes[source.key].width, y)]
        if end > start:
            for gap in range(start + 1, end + 1):
                x = self._x(gap, n)
                following = y_end if gap == end else layout.passages[n, gap].y + 2.0
                points += [(x, points[-1][1]), (x, following)]
        else:
            a, b = self._x(start + 1, n), self._x(end, -n - 1)
            points += [(a, y), (a, channels[n]), (b, channels[n]), (b, y_end)]
        points.append((self.lefts[end], y_end))
        return points

    def _x(self, gap: int, n: int) -> float:
        return self.gaps[gap] + _EDGE + TRACK * self.trunks[gap][n].track


def _assign(trunks: dict[int, _Trunk]) -> None:
    """Assign trunks to tracks so that neither they nor the lines to them overlap."""
    placed: list[_Trunk] = []
    waiting = sorted(trunks.values(), key=lambda t: (t.high - t.low, t.entry))
    # If the line into one lies at the height of the line out of another, it must end before.
    before = {
        id(t): [o for o in waiting if o is not t and any(abs(o.entry - y) < 4 for y in t.exits)]
        for t in waiting
    }
    while waiting:
        free = [t for t in waiting if not any(o in waiting for o in before[id(t)])]
        trunk = (free or waiting)[0]
        waiting.remove(trunk)
        track = max((o.track + 1 for o in before[id(trunk)] if o in placed), default=0)
        while any(
            o.track == track and o.low < trunk.high + 6 and trunk.low < o.high + 6 for o in placed
        ):
            track += 1
        trunk.track = track
        placed.append(trunk)
