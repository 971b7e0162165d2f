"""Figures of the benchmark: learning curves, an episode from above, returns in other water."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from uuvsim_cosim.view.plots.svg import Scale, nice_ticks, path, polygon, text
from uuvsim_cosim.view.recorded.traces import Array

__all__ = ["Curve", "Mark", "Panel", "curves_svg", "episode_svg", "transfer_svg"]

COLOURS = ("#1f5fa8", "#c2571a", "#3d8a4c", "#8c4a9e", "#7a6a2b", "#555c66")
SIZE = (330.0, 220.0)  # of a panel, pixels
LEFT, TOP, RIGHT, BOTTOM = 46.0, 30.0, 10.0, 34.0
PER_METRE = 95.0
NAMES, HEAD, ROW, WIDE = 264.0, 44.0, 46.0, 620.0  # of the figure by conditions
STYLE = (
    ".page{fill:#fff}.frame{fill:none;stroke:#9aa3ad}.grid{stroke:#e3e7eb}"
    ".strip{fill:#f5f7f9}.limit{stroke:#28303a;stroke-dasharray:5 4}"
    "text{font:11px system-ui,sans-serif;fill:#28303a}.title{font-weight:600;font-size:12px}"
    ".muted{fill:#5b6672}.yard{stroke:#28303a;stroke-dasharray:5 4;fill:none}"
    ".obstacle{fill:#b9c0c8;stroke:#7d868f}.safe{fill:none;stroke:#b9c0c8;stroke-dasharray:3 3}"
    + "".join(
        f".c{i}{{fill:none;stroke:{c};stroke-width:1.8}}.a{i}{{fill:{c};opacity:.18}}"
        f".d{i}{{fill:{c}}}.t{i}{{fill:{c}}}.l{i}{{stroke:{c};stroke-width:1.4}}"
        f".h{i}{{fill:#fff;stroke:{c};stroke-width:1.6}}"
        for i, c in enumerate(COLOURS)
    )
)


@dataclass(frozen=True)
class Curve:
    """Evaluations of one learning method: one row for each seed, over common steps."""

    name: str
    x: Array  # (k,)
    y: Array  # (seeds, k)


@final
@dataclass(frozen=True)
class Panel:
    """One scenario: curves, and the hand-written controller's value, a dashed line."""

    title: str
    x_label: str
    curves: Sequence[Curve]
    yardstick: float | None = None


@dataclass(frozen=True)
class Mark:
    """A value with its interval; `hollow` without anticipation."""

    value: float
    low: float
    high: float
    hollow: bool = False


def curves_svg(panels: Sequence[Panel], y_label: str, size: tuple[float, float] = SIZE) -> str:
    """Return panels side by side: medians of seeds, and the range between least and greatest.

    `size` is that of a panel, in pixels.
    """
    ways = list(dict.fromkeys(c.name for p in panels for c in p.curves))
    wide = size[0] * max(len(panels), 1)
    parts = [_panel(p, k * size[0], ways, y_label, size) for k, p in enumerate(panels)]
    words = [(f"c{i % 6}", name) for i, name in enumerate(ways)]
    if any(p.yardstick is not None for p in panels):
        words.append(("yard", "hand-written controller"))
    x, high = LEFT, size[1] + 18.0
    for kind, name in words:
        if x > LEFT and x + 23 + 6.2 * len(name) > wide:
            x, high = LEFT, high + 18.0
        parts.append(f'<path class="{kind}" d="M{x:.1f} {high - 9:.1f}h18"/>')
        parts.append(text(x + 23, high - 5, name, "muted"))
        x += 40 + 6.2 * len(name)
    return _whole(wide, high, parts)


def episode_svg(
    episode: Mapping[str, Array], trackers: int, arena: tuple[float, float], title: str
) -> str:
    """Return an episode from above, north up: paths, ends as dots, obstacles with d_so around.

    `episode` has columns x_1, y_1, …, x_T, y_T, x_o1, y_o1, r_o1, … [m]; `arena` is its size.
    """
    wide, tall = (PER_METRE * s for s in (arena[1], arena[0]))
    sx = Scale(-arena[1] / 2, arena[1] / 2, 10.0, 10.0 + wide)
    sy = Scale(-arena[0] / 2, arena[0] / 2, 24.0 + tall, 24.0)
    frame = f'<rect class="frame" x="10" y="24" width="{wide:.1f}" height="{tall:.1f}"/>'
    parts = [text(10, 15, title, "title"), frame]
    k = 1
    while f"x_o{k}" in episode:
        x, y, r = (float(episode[f"{a}_o{k}"][-1]) for a in "xyr")
        for kind, radius in (("obstacle", r), ("safe", r + 0.38)):
            parts.append(
                f'<circle class="{kind}" cx="{float(sx(y)):.1f}" cy="{float(sy(x)):.1f}" '
                f'r="{radius * PER_METRE:.1f}"/>'
            )
        k += 1
    names = [*(f"{i + 1}" for i in range(trackers)), "T"]
    for i, name in enumerate(names):
        colour = 5 if name == "T" else i % 5
        px, py = sx(episode[f"y_{name}"]), sy(episode[f"x_{name}"])
        parts.append(path(px, py, f"c{colour}"))
        parts.append(f'<circle class="d{colour}" cx="{px[-1]:.1f}" cy="{py[-1]:.1f}" r="4.5"/>')
        word = "target" if name == "T" else f"tracker {name}"
        parts.append(text(12 + 90 * i, 24 + tall + 17, word, f"t{colour}"))
    return _whole(wide + 20, tall + 50, parts)


def _panel(
    panel: Panel, at: float, ways: Sequence[str], y_label: str, size: tuple[float, float]
) -> str:
    width, height = size
    given = [c for c in panel.curves if c.y.size]
    values = [0.0, *(v for c in given for v in (c.y.min(), c.y.max()))]
    values += [] if panel.yardstick is None else [panel.yardstick]
    if not given:
        return text(at + LEFT, TOP - 12, f"{panel.title}: not yet run", "title")
    low, top = min(values), max(values)
    pad = 0.05 * (top - low or 1.0)
    sx = Scale(0.0, max(float(c.x[-1]) for c in given), at + LEFT, at + width - RIGHT)
    sy = Scale(low - pad, top + pad, height - BOTTOM, TOP)
    parts = [text(at + LEFT, TOP - 12, panel.title, "title")]
    for tick in nice_ticks(sy.low, sy.high):
        y = float(sy(tick))
        parts.append(f'<path class="grid" d="M{sx.start:.1f} {y:.1f}H{sx.end:.1f}"/>')
        parts.append(text(sx.start - 5, y + 4, f"{tick:g}", "muted", "end"))
    for tick in nice_ticks(sx.low, sx.high, 3):
        word = f"{tick / 1000:g}k" if tick >= 1000 else f"{tick:g}"
        parts.append(text(float(sx(tick)), height - BOTTOM + 15, word, "muted", "middle"))
    parts.append(text((sx.start + sx.end) / 2, height - 5, panel.x_label, "muted", "middle"))
    parts.append(text(at + width - RIGHT, TOP - 12, y_label, "muted", "end"))
    if panel.yardstick is not None:
        y = float(sy(panel.yardstick))
        parts.append(f'<path class="yard" d="M{sx.start:.1f} {y:.1f}H{sx.end:.1f}"/>')
    for c in given:
        i = ways.index(c.name) % 6
        if len(c.y) > 1:
            parts.append(polygon(sx(c.x), sy(c.y.min(axis=0)), sy(c.y.max(axis=0)), f"a{i}"))
        parts.append(path(sx(c.x), sy(np.median(c.y, axis=0)), f"c{i}"))
    return "".join(parts)


def transfer_svg(
    rows: Mapping[str, Mapping[str, Sequence[Mark]]],
    ways: Sequence[str],
    title: str,
    limit: tuple[float, str] | None = None,
) -> str:
    """Return conditions one below the other, and in each the marks of every way, by colour.

    `rows` are marks by way, by a condition's words; `limit` is a dashed line and what it means.
    """
    marks = [m for by in rows.values() for some in by.values() for m in some]
    low = 10.0 * math.floor(min([m.low for m in marks], default=0.0) / 10.0)
    sx = Scale(low, max([low + 1.0, *(m.high for m in marks)]) + 2.0, NAMES, NAMES + WIDE)
    bottom = HEAD + ROW * len(rows)
    parts = [text(12, 18, title, "title")]
    for k in range(0, len(rows), 2):
        y, wide = HEAD + ROW * k, NAMES + WIDE - 8
        parts.append(f'<rect class="strip" x="8" y="{y:.1f}" width="{wide:.1f}" height="{ROW}"/>')
    for tick in nice_ticks(sx.low, sx.high):
        x = float(sx(tick))
        parts.append(f'<path class="grid" d="M{x:.1f} {HEAD:.1f}V{bottom:.1f}"/>')
        parts.append(text(x, bottom + 15, f"{tick:g}", "muted", "middle"))
    if limit is not None:
        x = float(sx(limit[0]))
        parts.append(f'<path class="limit" d="M{x:.1f} {HEAD - 4:.1f}V{bottom:.1f}"/>')
        parts.append(text(x, HEAD - 9, limit[1], "muted", "middle"))
    apart = ROW / (len(ways) + 1)
    for k, (words, by) in enumerate(rows.items()):
        top = HEAD + ROW * k
        parts.append(text(NAMES - 12, top + ROW / 2 + 4, words, "", "end"))
        for i, way in enumerate(ways):
            y = top + apart * (i + 1)
            for m in by.get(way, ()):
                a, b, at = (float(sx(v)) for v in (m.low, m.high, m.value))
                parts.append(f'<path class="l{i % 6}" d="M{a:.1f} {y:.1f}H{b:.1f}"/>')
                kind = "h" if m.hollow else "d"
                parts.append(f'<circle class="{kind}{i % 6}" cx="{at:.1f}" cy="{y:.1f}" r="3.4"/>')
    x, y = 16.0, bottom + 38
    for i, way in enumerate(ways):
        parts.append(f'<circle class="d{i % 6}" cx="{x:.1f}" cy="{y - 4:.1f}" r="4"/>')
        parts.append(text(x + 9, y, way, "muted"))
        x += 30 + 6.2 * len(way)
    parts.append(text(x, y, "filled: anticipated; hollow: as it is", "muted"))
    return _whole(NAMES + WIDE + 16.0, bottom + 50, parts)


def _whole(width: float, height: float, parts: Sequence[str]) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}"><style>{STYLE}</style>'
        f'<rect class="page" width="100%" height="100%"/>{"".join(parts)}</svg>\n'
    )
