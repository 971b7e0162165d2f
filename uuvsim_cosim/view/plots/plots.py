"""Panels over time: lines and bands, and rows of filled bars; a report draws them by uPlot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.orchestrator.recording.samples import Array, Samples
from uuvsim_cosim.view.plots.page import MARKS
from uuvsim_cosim.view.plots.svg import (
    Scale,
    decimate,
    nice_ticks,
    path,
    polygon,
    text,
    time_ticks,
)

__all__ = ["Band", "Frame", "Line", "Panel", "Rows", "TimePanel"]

BINS = 420


@dataclass(frozen=True)
class Frame:
    """The size of a panel and the margins around its plotting area [px]."""

    width: float = 560
    height: float = 176
    left: float = 46
    right: float = 12
    top: float = 8
    bottom: float = 24

    def time_scale(self, time: Array) -> Scale:
        """Return the scale of the time axis."""
        return Scale(float(time[0]), float(time[-1]), self.left, self.width - self.right)


@dataclass(frozen=True)
class Line:
    """A curve over time; `style` is one of the page's classes, `digits` those of its value.

    With `digits` -1, the value is shown with five significant digits. `run` is 1 for the second
    run of a comparison.
    """

    label: str
    value: Samples
    style: str
    digits: int = 2
    dashed: bool = False
    run: int = 0


@dataclass(frozen=True)
class Band:
    """A filled region between two curves over time."""

    label: str
    low: Samples
    high: Samples
    style: str = "band"


@dataclass(frozen=True)
class Panel:
    """Base of panels: a title, a unit, and lines whose values are shown on hovering."""

    title: str
    unit: str
    lines: Sequence[Line] = ()

    def draw(self, time: Array, frame: Frame) -> str:
        """Return the inside of an SVG of the frame's size."""
        raise NotImplementedError


def _time_axis(time: Array, frame: Frame) -> str:
    x = frame.time_scale(time)
    ticks, unit, size = time_ticks(float(time[0]), float(time[-1]), int(frame.width / 95))
    bottom = frame.height - frame.bottom
    parts: list[str] = []
    for tick in ticks:
        px = float(x(tick))
        parts.append(f'<path class="grid" d="M{px:.1f} {frame.top:g}V{bottom:g}"/>')
        label = f"{tick / size:g}" + (f" {unit}" if tick == ticks[-1] else "")
        anchor = "end" if px > frame.width - frame.right - 12 else "middle"
        parts.append(text(px, bottom + 15, label, "tick", anchor))
    return "".join(parts)


@dataclass(frozen=True)
class TimePanel(Panel):
    """Curves and bands over time; `down` puts positive values below, as depth is drawn."""

    bands: Sequence[Band] = ()
    down: bool = False
    include: Sequence[float] = ()
    least_span: float = 0.0

    def limits(self) -> tuple[float, float]:
        """Return the range of the value axis: all of the lines, most of the bands."""
        values = (np.asarray(line.value) for line in self.lines)
        finite = [value[np.isfinite(value)] for value in values]
        lows = [float(v.min()) for v in finite if v.size] + list(self.include)
        highs = [float(v.max()) for v in finite if v.size] + list(self.include)
        low, high = (min(lows), max(highs)) if lows else (0.0, 1.0)
        for band in self.bands:  # without their extremes: at the start, a band may be far wider
            low = min(low, 1.25 * float(np.nanpercentile(np.asarray(band.low), 15)))
            high = max(high, 1.25 * float(np.nanpercentile(np.asarray(band.high), 85)))
        span = max(high - low, self.least_span, 1e-9)
        middle = 0.5 * (low + high)
        return middle - 0.55 * span, middle + 0.55 * span

    def draw(self, time: Array, frame: Frame) -> str:
        """Return the inside of an SVG of the frame's size."""
        y = self._scale(frame)
        low, high = y.low, y.high
        x = frame.time_scale(time)
        parts = [_time_axis(time, frame)]
        right = frame.width - frame.right
        for tick in nice_ticks(y.low, y.high, max(3, int(frame.height / 34))):
            py = float(y(tick))
            style = "zero" if tick == 0 else "grid"
            parts.append(f'<path class="{style}" d="M{frame.left:g} {py:.1f}H{right:g}"/>')
            label = f"{tick:g}".replace("-", "−")
            parts.append(text(frame.left - 6, py + 3.5, label, "tick", "end"))
        every = max(1, len(time) // BINS)
        for band in self.bands:
            limit = [np.clip(np.asarray(v)[::every], low, high) for v in (band.low, band.high)]
            parts.append(polygon(x(time[::every]), y(limit[0]), y(limit[1]), band.style))
        for line in self.lines:
            t, v = decimate(time, np.asarray(line.value), BINS)
            style = f"line {line.style}" + (" dash" if line.dashed else "")
            parts.append(path(x(t), y(v), style))
        return "".join(parts)

    def marks(self, time: Array, frame: Frame) -> str:
        """Return about six marks on each line, by which lines are told apart without colour."""
        x, y = frame.time_scale(time), self._scale(frame)
        return "".join(
            f'<path class="marker {line.style}" d="{MARKS[line.style]}" transform='
            f'"translate({float(x(time[i])):.1f} {float(y(value[i])):.1f})"/>'
            for k, line in enumerate(self.lines)
            for value in [np.asarray(line.value)]
            for i in range((k + 1) * len(time) // (6 * len(self.lines) + 1), len(time),
                           max(1, len(time) // 6))
            if np.isfinite(value[i])
        )  # fmt: skip

    def _scale(self, frame: Frame) -> Scale:
        low, high = self.limits()
        bottom = frame.height - frame.bottom
        ends = (frame.top, bottom) if self.down else (bottom, frame.top)
        return Scale(low, high, *ends)


@dataclass(frozen=True)
class Rows(Panel):
    """One row for each line on a common scale, filled from zero: the mean and the extremes."""

    def reach(self) -> float:
        """Return the greatest magnitude of all lines: half the height of a row."""
        most = [
            float(np.nanmax(np.abs(np.asarray(line.value)), initial=0.0)) for line in self.lines
        ]
        return max(most, default=0.0) or 1.0

    def draw(self, time: Array, frame: Frame) -> str:
        """Return the inside of an SVG of the frame's size."""
        reach = self.reach()
        top = frame.top + 12
        row = (frame.height - top - frame.bottom) / max(len(self.lines), 1)
        x = frame.time_scale(time)
        size = max(1, len(time) // BINS)
        whole = len(time) // size
        parts = [_time_axis(time, frame)]
        px = x(time[: whole * size].reshape(whole, size).mean(axis=1))
        for number, line in enumerate(self.lines):
            middle = top + row * (number + 0.5)
            y = Scale(-reach, reach, middle + 0.48 * row, middle - 0.48 * row)
            block = np.asarray(line.value)[: whole * size].reshape(whole, size)
            low, high, mean = block.min(axis=1), block.max(axis=1), block.mean(axis=1)
            zero = np.full(whole, middle)
            parts.append(polygon(px, y(np.minimum(low, 0)), y(np.maximum(high, 0)), "extreme"))
            parts.append(polygon(px, zero, y(np.maximum(mean, 0)), "ahead"))
            parts.append(polygon(px, y(np.minimum(mean, 0)), zero, "astern"))
            right = frame.width - frame.right
            parts.append(f'<path class="grid" d="M{frame.left:g} {middle:.1f}H{right:g}"/>')
            parts.append(text(frame.left - 6, middle + 3.5, line.label, "tick", "end"))
        right = frame.width - frame.right
        parts.append(f'<path class="axis" d="M{right + 3:g} {top:.1f}v{row:.1f}"/>')
        legend = f"height of a row: ±{reach:.3g} {self.unit}"
        return "".join(parts) + text(right + 3, top - 4, legend, "tick", "end")
