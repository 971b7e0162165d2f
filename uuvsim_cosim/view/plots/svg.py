"""Scales, ticks and SVG paths of the reports' plots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.view.recorded.traces import Array

__all__ = ["Scale", "decimate", "escape", "nice_ticks", "path", "polygon", "text", "time_ticks"]


@dataclass(frozen=True)
class Scale:
    """A linear map from values [low, high] to pixels [start, end]."""

    low: float
    high: float
    start: float
    end: float

    def __call__(self, value: Array | float) -> Array:
        """Return the pixel of a value."""
        span = self.high - self.low or 1.0
        return self.start + (np.asarray(value, dtype=float) - self.low) / span * (
            self.end - self.start
        )


def escape(text: object) -> str:
    """Return text that is safe inside SVG and HTML, attributes included."""
    replaced = str(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    return replaced.replace('"', "&quot;").replace("'", "&#39;")


def nice_ticks(low: float, high: float, count: int = 4) -> list[float]:
    """Return round values inside [low, high], about `count` of them, and at least two."""
    span = high - low
    if not np.isfinite(span) or span <= 0:
        return [low]
    for wanted in range(max(count, 1), max(count, 1) + 6):
        rough = span / wanted
        power = 10.0 ** np.floor(np.log10(rough))
        step = power * next(m for m in (1, 2, 2.5, 5, 10) if m * power >= rough * 0.999)
        first = np.ceil(low / step - 1e-9)
        last = np.floor(high / step + 1e-9)
        if last > first:
            break
    return [float(round(k * step, 10)) + 0.0 for k in np.arange(first, last + 1)]


def time_ticks(start: float, end: float, count: int = 6) -> tuple[list[float], str, float]:
    """Return ticks [s], the unit to label them in, and that unit in seconds."""
    unit, size = ("s", 1.0) if end - start < 240 else ("min", 60.0)
    if end - start >= 4 * 3600:
        unit, size = "h", 3600.0
    return [tick * size for tick in nice_ticks(start / size, end / size, count)], unit, size


def decimate(time: Array, value: Array, bins: int) -> tuple[Array, Array]:
    """Return at most 2·bins samples: the least and the greatest of each bin, in order of time.

    Peaks are kept, unlike with every n-th sample. A signal with few samples is returned whole.
    """
    if len(time) <= 2 * bins:
        return time, value
    size = -(-len(time) // bins)
    whole = len(time) // size
    block = np.nan_to_num(value[: whole * size].reshape(whole, size), nan=0.0)
    base = np.arange(whole) * size
    picks = [base + block.argmin(axis=1), base + block.argmax(axis=1)]
    index = np.unique(np.concatenate([*picks, [0, len(time) - 1]]))
    return time[index], value[index]


def path(x: Array, y: Array, style: str, extra: str = "") -> str:
    """Return an SVG path through the points; non-finite points break it."""
    good = np.isfinite(x) & np.isfinite(y)
    pieces: list[str] = []
    pen_down = False
    for px, py, ok in zip(x, y, good, strict=True):
        if ok:
            pieces.append(f"{'L' if pen_down else 'M'}{px:.1f} {py:.1f}")
        pen_down = bool(ok)
    return f'<path class="{style}" d="{"".join(pieces)}"{extra}/>'


def polygon(x: Array, low: Array, high: Array, style: str) -> str:
    """Return the filled area between two curves; non-finite points are left out."""
    good = np.isfinite(low) & np.isfinite(high)
    x, low, high = x[good], low[good], high[good]
    if len(x) < 2:
        return ""
    points = [f"{a:.1f} {b:.1f}" for a, b in zip(x, high, strict=True)]
    points += [f"{a:.1f} {b:.1f}" for a, b in zip(x[::-1], low[::-1], strict=True)]
    return f'<path class="{style}" d="M{"L".join(points)}Z"/>'


def text(x: float, y: float, content: object, style: str, anchor: str = "start") -> str:
    """Return an SVG text."""
    place = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return f'<text class="{style}" x="{x:.1f}" y="{y:.1f}"{place}>{escape(content)}</text>'
