"""Plot of figure 11: returns of each learning method in water that it was not trained in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from uuvsim_cosim.view.plots.svg import Scale, nice_ticks, text
from uuvsim_cosim.view.reports.reproduction_figures import COLOURS, escape_style

__all__ = ["Mark", "transfer_svg"]

LEFT, TOP, ROW, RIGHT = 264.0, 44.0, 46.0, 16.0
WIDE = 620.0
STYLE = (
    ".page{fill:#fff}.grid{stroke:#e3e7eb}.band{fill:#f5f7f9}"
    "text{font:11px system-ui,sans-serif;fill:#28303a}.title{font-weight:600;font-size:12px}"
    ".muted{fill:#5b6672}.limit{stroke:#28303a;stroke-dasharray:5 4}"
    + "".join(
        f".d{i}{{fill:{c};stroke:{c}}}.h{i}{{fill:#fff;stroke:{c};stroke-width:1.6}}"
        f".l{i}{{stroke:{c};stroke-width:1.4}}"
        for i, c in enumerate(COLOURS)
    )
)


@dataclass(frozen=True)
class Mark:
    """A value with its interval; `hollow` without anticipation."""

    value: float
    low: float
    high: float
    hollow: bool = False


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
    sx = Scale(low, max([low + 1.0, *(m.high for m in marks)]) + 2.0, LEFT, LEFT + WIDE)
    bottom = TOP + ROW * len(rows)
    parts = [text(12, 18, title, "title")]
    for k in range(0, len(rows), 2):
        y, wide = TOP + ROW * k, LEFT + WIDE - 8
        parts.append(f'<rect class="band" x="8" y="{y:.1f}" width="{wide:.1f}" height="{ROW}"/>')
    for tick in nice_ticks(sx.low, sx.high):
        x = float(sx(tick))
        parts.append(f'<path class="grid" d="M{x:.1f} {TOP:.1f}V{bottom:.1f}"/>')
        parts.append(text(x, bottom + 15, f"{tick:g}", "muted", "middle"))
    if limit is not None:
        x = float(sx(limit[0]))
        parts.append(f'<path class="limit" d="M{x:.1f} {TOP - 4:.1f}V{bottom:.1f}"/>')
        parts.append(text(x, TOP - 9, limit[1], "muted", "middle"))
    apart = ROW / (len(ways) + 1)
    for k, (words, by) in enumerate(rows.items()):
        top = TOP + ROW * k
        parts.append(text(LEFT - 12, top + ROW / 2 + 4, words, "", "end"))
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
    width, height = LEFT + WIDE + RIGHT, bottom + 50
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}"><style>{escape_style(STYLE)}</style>'
        f'<rect class="page" width="100%" height="100%"/>{"".join(parts)}</svg>\n'
    )
