"""The track seen from above: north up, equal axes, path, truth, estimate and current."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.orchestrator.recording.samples import Array
from uuvsim_cosim.view.plots.page import MARKS
from uuvsim_cosim.view.plots.svg import Scale, nice_ticks, path, text

__all__ = ["VESSEL", "Track"]

POINTS = 1600
VESSEL = "M9 0L-6 5.5L-3 0L-6 -5.5Z"


@dataclass(frozen=True)
class Track:
    """A plan view of `width` px; its height follows from the data, between two bounds."""

    time: Array
    eta: Array  # (T, 6) true
    path: Array | None = None  # (n, 3) waypoints
    estimate: Array | None = None  # (T, >= 2)
    fixes: Array | None = None  # (k, 2) position fixes, e.g. of USBL
    current: Array | None = None  # (T, >= 2)
    other: Array | None = None  # (T', >= 2) true positions of the run that it is compared with
    width: float = 720
    tallest: float = 660
    least: float = 320

    def scales(self) -> tuple[Scale, Scale, float]:
        """Return the scales of east and north, and the height, with one metre equal on both."""
        points = [self.eta[:, :2]]
        points += [p[:, :2] for p in (self.path, self.estimate, self.other) if p is not None]
        everything = np.concatenate(points)
        everything = everything[np.isfinite(everything).all(axis=1)]
        low, high = everything.min(axis=0), everything.max(axis=0)
        span = np.maximum(high - low, 1.0) * 1.12
        middle = 0.5 * (low + high)
        left, right, top, bottom = 46.0, 14.0, 12.0, 34.0
        inner = self.width - left - right
        height = float(np.clip(inner * span[0] / span[1] + top + bottom, self.least, self.tallest))
        scale = max(span[0] / (height - top - bottom), span[1] / inner)  # metres a pixel
        half = 0.5 * scale * np.array([height - top - bottom, inner])
        east = Scale(middle[1] - half[1], middle[1] + half[1], left, left + inner)
        north = Scale(middle[0] - half[0], middle[0] + half[0], height - bottom, top)
        return east, north, height

    def draw(self) -> str:
        """Return the inside of an SVG of `width` and the height of `scales`."""
        x, y, height = self.scales()
        parts = [self._axes(x, y, height)]
        if self.current is not None:
            parts.append(self._arrows(x, y))
        if self.fixes is not None:
            dots = "".join(
                f"M{a:.1f} {b:.1f}h.01"
                for a, b in zip(x(self.fixes[:, 1]), y(self.fixes[:, 0]), strict=True)
                if np.isfinite(a + b) and x.start < a < x.end and y.end < b < y.start
            )
            parts.append(f'<path class="fix" d="{dots}"/>')
        if self.path is not None:
            east, north = x(self.path[:, 1]), y(self.path[:, 0])
            parts.append(path(east, north, "line desired dash"))
            parts += [
                f'<circle class="waypoint" cx="{a:.1f}" cy="{b:.1f}" r="3"/>'
                for a, b in zip(east, north, strict=True)
            ]
        picks = np.unique(np.linspace(0, len(self.time) - 1, POINTS).astype(int))
        parts.append(path(x(self.eta[picks, 1]), y(self.eta[picks, 0]), "line truth thick"))
        if self.estimate is not None:
            east, north = x(self.estimate[picks, 1]), y(self.estimate[picks, 0])
            parts.append(path(east, north, "line estimate"))
            parts += [
                f'<path class="estimate marker" d="{MARKS["estimate"]}" '
                f'transform="translate({east[i]:.1f} {north[i]:.1f}) scale(.8)"/>'
                for i in range(len(picks) // 32, len(picks), max(1, len(picks) // 16))
                if np.isfinite(east[i] + north[i])
            ]
        if self.other is not None:
            some = np.unique(np.linspace(0, len(self.other) - 1, POINTS).astype(int))
            east, north = x(self.other[some, 1]), y(self.other[some, 0])
            parts.append(path(east, north, "line estimate dash"))
            parts += [
                f'<path class="estimate marker open" d="{MARKS["estimate"]}" '
                f'transform="translate({east[i]:.1f} {north[i]:.1f})"/>'
                for i in range(0, len(some), max(1, len(some) // 16))
            ]
        for i in self._spaced(x, y, 120.0):
            degrees = np.degrees(self.eta[i, 5]) - 90.0
            a, b = float(x(self.eta[i, 1])), float(y(self.eta[i, 0]))
            parts.append(
                f'<path class="vessel" d="{VESSEL}" '
                f'transform="translate({a:.1f} {b:.1f}) rotate({degrees:.0f}) scale(.8)"/>'
            )
        parts.append(self._mark(x, y, 0, "start"))
        parts.append(self._mark(x, y, -1, "end"))
        return "".join(parts)

    def _axes(self, x: Scale, y: Scale, height: float) -> str:
        parts: list[str] = []
        for tick in nice_ticks(x.low, x.high, 8):
            px = float(x(tick))
            parts.append(f'<path class="grid" d="M{px:.1f} {y.end:.1f}V{y.start:.1f}"/>')
            parts.append(text(px, y.start + 14, f"{tick:g}".replace("-", "−"), "tick", "middle"))
        for tick in nice_ticks(y.low, y.high, 6):
            py = float(y(tick))
            parts.append(f'<path class="grid" d="M{x.start:.1f} {py:.1f}H{x.end:.1f}"/>')
            label = f"{tick:g}".replace("-", "−")
            parts.append(text(x.start - 6, py + 3.5, label, "tick", "end"))
        parts.append(text(x.end, height - 5, "east [m]", "tick", "end"))
        parts.append(
            f'<text class="tick" text-anchor="end" transform="translate(11 {y.end:.1f}) '
            'rotate(-90)">north [m]</text>'
        )
        return "".join(parts)

    def _arrows(self, x: Scale, y: Scale) -> str:
        assert self.current is not None
        speed = np.hypot(self.current[:, 0], self.current[:, 1])
        reach = float(np.nanmax(speed, initial=0.0))
        if reach <= 0:
            return ""
        length = 26.0 / reach
        heads = []
        for i in self._spaced(x, y, 42.0):
            n, e = self.current[i, :2] * length
            if np.hypot(n, e) < 4:
                continue
            a, b = float(x(self.eta[i, 1])), float(y(self.eta[i, 0]))
            unit = np.array([e, -n]) / np.hypot(n, e)
            side = np.array([-unit[1], unit[0]])
            tip = np.array([a + e, b - n])
            p, q = tip - 5 * unit + 2.6 * side, tip - 5 * unit - 2.6 * side
            heads.append(
                f"M{a:.1f} {b:.1f}L{tip[0]:.1f} {tip[1]:.1f}M{p[0]:.1f} {p[1]:.1f}"
                f"L{tip[0]:.1f} {tip[1]:.1f}L{q[0]:.1f} {q[1]:.1f}"
            )
        return f'<path class="current" d="{"".join(heads)}"/>'

    def _spaced(self, x: Scale, y: Scale, distance: float) -> list[int]:
        """Return samples along the track that lie about `distance` px apart."""
        picks = np.unique(np.linspace(0, len(self.time) - 1, 4000).astype(int))
        a, b = x(self.eta[picks, 1]), y(self.eta[picks, 0])
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(a), np.diff(b)))])
        wanted = np.arange(0.5 * distance, along[-1], distance)
        return [int(i) for i in picks[np.searchsorted(along, wanted)]]

    def _mark(self, x: Scale, y: Scale, i: int, label: str) -> str:
        a, b = float(x(self.eta[i, 1])), float(y(self.eta[i, 0]))
        above = -10 if b - 14 > y.end else 18
        return f'<circle class="mark {label}" cx="{a:.1f}" cy="{b:.1f}" r="5"/>' + text(
            a, b + above, label, "label halo", "middle"
        )
