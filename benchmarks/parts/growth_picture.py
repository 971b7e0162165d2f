"""Picture of `growth.py`: each stage over the size of its system, logarithmic, with slopes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from uuvsim_cosim.view.plots.page import MARKS, picture_styles
from uuvsim_cosim.view.plots.svg import Scale, path, text

__all__ = ["picture", "slope"]

Sizes = Mapping[int, float]  # CPU seconds, or MB, by size

# Measured by the same stages on the version before they were changed, at about the same load. Those
# of the loop delays are from a ring of 8 to 10 vehicles; a fleet of 100 was not fused after 364 s.
# Of figures that varied, these are the lowest.
BEFORE: Mapping[str, Sizes] = {
    "build: add, connect, set": {300: 10.6, 1000: 52.0},
    "flatten": {3000: 2.3},
    "write .ssd, read it again": {3000: 4.7},
    "instantiate, initialise": {3000: 2.4},
    "convoy: flatten": {100: 3.1},
    "convoy: loop delays": {8: 2.8, 9: 17.6, 10: 83.0},
    "fleet: fuse, cold": {100: 364.0},
    "fleet: fuse, warm": {100: 4.0},
    "fleet: native instances": {100: 24.0},
    "survey: run: peak MB": {400: 298.0, 4000: 697.0},
    "survey: report: peak MB": {400: 245.0, 4000: 561.0},
    "survey: export mat: peak MB": {400: 352.0, 4000: 1915.0},
}
SIZES = {"fleet": "vehicles", "convoy": "vehicles", "survey": "length [s]"}  # else components
COLUMNS, CARD, WIDE, TALL = 3, (292.0, 214.0), 268.0, 168.0  # px
LEFT, RIGHT, TOP, BOTTOM = 40.0, 14.0, 8.0, 36.0


def slope(values: Sizes) -> float:
    """Return the slope of a straight line through log(value) over log(size)."""
    sizes = sorted(values)
    x, y = np.log(sizes), np.log([max(values[n], 1e-4) for n in sizes])
    return float(np.polyfit(x, y, 1)[0])


def picture(found: Mapping[str, Sizes]) -> str:
    """Return the SVG of the stages that have figures from before, beside those of now."""
    shown = [name for name in BEFORE if len(found.get(name, {})) > 1]
    step = CARD[0] + 12, CARD[1] + 12
    width = 12 + COLUMNS * step[0]
    height = 44 + math.ceil(len(shown) / COLUMNS) * step[1]
    cards = []
    for k, name in enumerate(shown):
        x, y = 12 + k % COLUMNS * step[0], 44 + k // COLUMNS * step[1]
        of, memory, _ = name.partition(": peak MB")
        title = f"{of}, memory [MB]" if memory else f"{name} [CPU s]"
        inside = "".join(_panel(name, found[name], BEFORE[name]))
        cards.append(
            f'<g transform="translate({x:g} {y:g})">'
            f'<rect class="card" width="{CARD[0]:g}" height="{CARD[1]:g}" rx="10"/>'
            + text(14, 20, title, "heading")
            + f'<g transform="translate(12 34)">{inside}</g></g>'
        )
    keys = "".join(
        f'<g transform="translate({x} 24)"><path class="line {style}" d="M0 0h22"/>'
        + _mark(style, 11, 0)
        + text(28, 4, label, "tick")
        + "</g>"
        for x, style, label in (
            (16, "truth", "now"), (90, "estimate", "before"),
            (180, "desired dash", "proportional to the size"),
        )
    )  # fmt: skip
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        f'width="{width:g}" height="{height:g}"><style>{picture_styles()}</style>'
        f'<rect class="page" width="{width:g}" height="{height:g}" rx="14"/>{keys}'
        + "".join(cards)
        + "</svg>\n"
    )


def _panel(name: str, now: Sizes, before: Sizes) -> Iterator[str]:
    """Yield the inside of a card: axes with powers of ten, a line of slope 1, both curves."""
    sizes = np.log10([*now, *before])
    values = np.log10([max(v, 1e-4) for v in [*now.values(), *before.values()]])
    bottom = TALL - BOTTOM
    sx = Scale(sizes.min() - 0.1, sizes.max() + 0.1, LEFT, WIDE - RIGHT)
    sy = Scale(values.min() - 0.25, max(values.max() + 0.25, values.min() + 1.2), bottom, TOP)
    for n in sorted({*now, *before} - ({8, 9} & {*before})):
        x = float(sx(math.log10(n)))
        yield f'<path class="grid" d="M{x:.1f} {TOP:g}V{bottom:g}"/>'
        yield text(x, bottom + 14, f"{n:,}", "tick", "middle")
    for power in range(math.floor(sy.low), math.floor(sy.high) + 1):
        for times in (1, 3) if sy.high - sy.low < 2 else (1,):
            y = float(sy(power + math.log10(times)))
            if TOP <= y <= bottom:
                yield f'<path class="grid" d="M{LEFT:g} {y:.1f}H{WIDE - RIGHT:g}"/>'
                yield text(LEFT - 6, y + 3.5, f"{times * 10.0**power:g}", "tick", "end")
    of = SIZES.get(name.partition(":")[0], "components")
    yield text((LEFT + WIDE - RIGHT) / 2, TALL - 6, of, "tick", "middle")
    first = min(now)
    ends = np.log10([first, max(now)])
    line = math.log10(max(now[first], 1e-4)) + ends - ends[0]
    keep = line <= sy.high
    if not keep[-1]:
        ends[-1], line[-1] = ends[0] + sy.high - line[0], sy.high
    yield path(sx(ends), sy(line), "line desired dash")
    for style, curve in (("estimate", before), ("truth", now)):
        x = sx(np.log10(sorted(curve)))
        y = sy(np.log10([max(curve[n], 1e-4) for n in sorted(curve)]))
        yield path(x, y, f"line {style}")
        yield from (_mark(style, px, py) for px, py in zip(x, y, strict=True))
        if len(curve) > 1:
            inside = x[-1] > WIDE - RIGHT - 60
            place = (x[-1] - 8, "end") if inside else (x[-1] + 8, "start")
            yield text(
                place[0], y[-1] - 8, f"slope {round(slope(curve), 1) + 0.0:.1f}", "tick", place[1]
            )


def _mark(style: str, x: float, y: float) -> str:
    if style not in MARKS or style == "desired":
        return ""
    place = f"translate({x:.1f} {y:.1f})"
    return f'<path class="marker {style}" d="{MARKS[style]}" transform="{place}"/>'
