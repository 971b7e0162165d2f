"""Plots of a study: distribution of a metric, means along the grid, scatter by parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.view.plots.page import MARKS, key_html
from uuvsim_cosim.view.plots.svg import Scale, escape, nice_ticks, path, polygon, text
from uuvsim_cosim.view.recorded.traces import Array

__all__ = ["Course", "card", "grid_lines", "histogram", "scatter"]

WIDTH, HEIGHT = 480.0, 250.0
LEFT, RIGHT, TOP, BOTTOM = 56.0, 14.0, 10.0, 40.0
STYLES = ("truth", "estimate", "third", "fourth")
MOST_DOTS = 1500


@dataclass(frozen=True)
class Course:
    """Means along an axis, with their intervals; NaN where there is none."""

    label: str
    x: Array
    mean: Array
    low: Array
    high: Array


def card(title: str, unit: str, body: str, keys: Sequence[tuple[str, str]] = ()) -> str:
    """Return a picture with its title; `keys` are (style, label)."""
    legend = ""
    for style, label in keys:
        dashed = "dash" in style
        mark = "" if dashed else None
        legend += key_html(style.split()[0], label, dashed=dashed, mark=mark)
    return (
        f'<div class="card"><h3>{escape(title)} '
        f'<span class="unit">{f"[{escape(unit)}]" if unit not in ("", "1") else ""}</span>'
        f'<span class="keys">{legend}</span></h3>'
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{escape(title)}">'
        f"{body}</svg></div>"
    )


def histogram(values: Array) -> str:
    """Return bars over equal classes; their number is about that of Freedman and Diaconis."""
    x = values[np.isfinite(values)]
    if not len(x):
        return text(WIDTH / 2, HEIGHT / 2, "no finite values", "tick", "middle")
    low, high = float(x.min()), float(x.max())
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-300):
        low, high = low - 0.5 * (abs(low) or 1.0), high + 0.5 * (abs(high) or 1.0)
    spread = float(np.subtract(*np.quantile(x, [0.75, 0.25])))
    width = 2.0 * spread / len(x) ** (1 / 3)
    bins = int(np.clip(np.ceil((high - low) / width) if width > 0 else 12, 6, 48))
    counts, edges = np.histogram(x, bins, (low, high))
    sx = Scale(low, high, LEFT, WIDTH - RIGHT)
    sy = Scale(0.0, 1.08 * counts.max(), HEIGHT - BOTTOM, TOP)
    bars = "".join(
        f'<rect class="bar" x="{float(sx(a)) + 0.5:.1f}" y="{float(sy(c)):.1f}" '
        f'width="{max(float(sx(b) - sx(a)) - 1.0, 0.5):.1f}" '
        f'height="{float(sy(0.0) - sy(c)):.1f}"/>'
        for c, a, b in zip(counts, edges[:-1], edges[1:], strict=True)
        if c
    )
    middle = float(sx(float(np.median(x))))
    mark = f'<path class="line estimate dash" d="M{middle:.1f} {TOP:g}V{HEIGHT - BOTTOM:g}"/>'
    return _axes(sx, sy, "", whole=True) + bars + mark


def scatter(x: Array, y: Array, label: str) -> str:
    """Return one dot for each run, thinned evenly if there are too many."""
    good = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    if not len(good):
        return text(WIDTH / 2, HEIGHT / 2, "no finite values", "tick", "middle")
    good = good[np.unique(np.linspace(0, len(good) - 1, MOST_DOTS).astype(int))]
    x, y = x[good], y[good]
    sx = Scale(*_padded(x), LEFT, WIDTH - RIGHT)
    sy = Scale(*_padded(y), HEIGHT - BOTTOM, TOP)
    dots = "".join(
        f"M{px:.1f} {py:.1f}h.01" for px, py in zip(sx(x).tolist(), sy(y).tolist(), strict=True)
    )
    return _axes(sx, sy, label) + f'<path class="dots" d="{dots}"/>'


def grid_lines(courses: Sequence[Course], label: str) -> str:
    """Return means along an axis of the grid, each with the band of its interval."""
    every = np.concatenate([np.concatenate([c.mean, c.low, c.high]) for c in courses])
    every = every[np.isfinite(every)]
    if not len(every):
        return text(WIDTH / 2, HEIGHT / 2, "no finite values", "tick", "middle")
    sx = Scale(*_padded(np.concatenate([c.x for c in courses]), 0.02), LEFT, WIDTH - RIGHT)
    sy = Scale(*_padded(every), HEIGHT - BOTTOM, TOP)
    bands, lines = "", ""
    for course, style in zip(courses, STYLES, strict=False):
        x, mean = sx(course.x), sy(course.mean)
        bands += polygon(x, sy(course.low), sy(course.high), f"area {style}")
        lines += path(x, mean, f"line {style}")
        for px, py in zip(x, mean, strict=True):
            if np.isfinite(py):
                place = f"translate({px:.1f} {py:.1f})"
                lines += f'<path class="marker {style}" d="{MARKS[style]}" transform="{place}"/>'
    return _axes(sx, sy, label) + bands + lines


def _padded(values: Array, share: float = 0.05) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    pad = share * (high - low) or 0.5 * abs(high) or 0.5
    return low - pad, high + pad


def _axes(sx: Scale, sy: Scale, x_label: str, whole: bool = False) -> str:
    bottom = HEIGHT - BOTTOM
    parts = []
    for tick in nice_ticks(sx.low, sx.high, 5):
        px = float(sx(tick))
        parts.append(f'<path class="grid" d="M{px:.1f} {TOP:g}V{bottom:g}"/>')
        parts.append(text(px, bottom + 14, _number(tick), "tick", "middle"))
    for tick in nice_ticks(sy.low, sy.high, 4):
        if whole and tick != round(tick):
            continue
        py = float(sy(tick))
        style = "zero" if tick == 0 else "grid"
        parts.append(f'<path class="{style}" d="M{LEFT:g} {py:.1f}H{WIDTH - RIGHT:g}"/>')
        parts.append(text(LEFT - 6, py + 3.5, _number(tick), "tick", "end"))
    if x_label:
        parts.append(text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 6, x_label, "tick", "middle"))
    return "".join(parts)


def _number(value: float) -> str:
    return f"{value:g}".replace("-", "−")
