"""Picture of opened loops: Bode diagram, Nyquist diagram, poles and step responses, as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import written
from uuvsim_cosim.orchestrator.analysis.opened_loop import OpenedLoop
from uuvsim_cosim.view.plots.page import MARKS, picture_styles
from uuvsim_cosim.view.plots.svg import Scale, nice_ticks, path, text
from uuvsim_cosim.view.recorded.traces import Array

__all__ = ["loop_picture", "write_loop_picture"]

WIDTH, HEAD, PAD, GAP = 1060.0, 62.0, 16.0, 14.0
LEFT, BOTTOM, TOP = 52.0, 34.0, 32.0  # inside a panel
STYLES = ("truth", "estimate", "third", "fourth", "fifth", "sixth")
LEAST, MOST = -60.0, 60.0  # dB that are drawn


def write_loop_picture(loops: Sequence[OpenedLoop], title: str, out: str | Path) -> Path:
    """Write the picture of the loops of one signal as SVG."""
    return written(Path(out), loop_picture(loops, title), make_folder=True)


def loop_picture(loops: Sequence[OpenedLoop], title: str) -> str:
    """Return the picture of at most six loops: a line style for each, one legend."""
    loops = loops[: len(STYLES)]
    half = (WIDTH - 2 * PAD - GAP) / 2
    omegas = [_shown(loop) for loop in loops]
    responses = [loop.response(w) for loop, w in zip(loops, omegas, strict=True)]
    low, high = min(w[0] for w in omegas), max(w[-1] for w in omegas)
    x = Scale(np.log10(low), np.log10(high), LEFT, half - 14)
    lines = list(zip(STYLES, [np.log10(w) for w in omegas], responses, strict=False))
    gain, lag, nyquist, poles, step = (_Panel(half, h) for h in (230.0, 200.0, 337.0, 337.0, 230.0))
    gain.decades(x)
    gain.rows(Scale(LEAST, MOST, gain.bottom, TOP), [-60, -40, -20, 0, 20, 40, 60])
    gain.draw((s, x(w), gain.y(_within(_decibels(L), LEAST, MOST))) for s, w, L in lines)
    lag.decades(x, "ω [rad/s]")
    phases = [_degrees(L) for _, _, L in lines]
    least = 90 * np.floor(min(np.min(p[np.isfinite(p)], initial=-180.0) for p in phases) / 90)
    bottom = max(float(least), -540.0)
    lag.rows(Scale(bottom, 0.0, lag.bottom, TOP), np.arange(bottom, 1, 90).tolist())
    lag.draw((s, x(w), lag.y(_within(p, bottom, 0.0)))
             for (s, w, _), p in zip(lines, phases, strict=True))  # fmt: skip
    _nyquist(nyquist, lines)
    _poles(poles, loops)
    _steps(step, loops)
    panels = [
        (0, 0.0, gain, "Magnitude of L [dB]"), (0, 230.0 + GAP, lag, "Phase of L [°]"),
        (0, 430.0 + 2 * GAP, step, "Step response of the closed loop over time [s]"),
        (1, 0.0, nyquist, "Nyquist diagram of L near −1"),
        (1, 337.0 + GAP, poles, "Poles of the closed loop [1/s]"),
    ]  # fmt: skip
    height = HEAD + 660.0 + 2 * GAP + PAD
    keys, at = "", PAD + 2
    for loop, style in zip(loops, STYLES, strict=False):
        keys += f'<path class="line {style}" d="M{at:.0f} 44h20"/>'
        place = f"translate({at + 10:.0f} 44)"
        keys += f'<path class="{style} marker" d="{MARKS[style]}" transform="{place}"/>'
        keys += text(at + 26, 48, loop.signal, "tick")
        at += 6.4 * len(loop.signal) + 46
    body = "".join(
        f'<g transform="translate({PAD + column * (half + GAP):.1f} {HEAD + y:.1f})">'
        f"{panel.svg(label)}</g>"
        for column, y, panel, label in panels
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height:g}" '
        f'width="{WIDTH:g}" height="{height:g}" role="img"><style>{picture_styles()}</style>'
        f'<rect class="page" width="{WIDTH:g}" height="{height:g}" rx="12"/>'
        + text(PAD + 2, 26, title, "heading")
        + keys
        + body
        + "</svg>\n"
    )


def _shown(loop: OpenedLoop) -> Array:
    """Return the frequencies to draw: two decades around the crossover, up to Nyquist's."""
    crossover = loop.margins.crossover
    center = crossover if np.isfinite(crossover) else 1.0
    return np.geomspace(center / 100, min(center * 100, np.pi / loop.tick * 0.999), 400)


def _within(values: Array, low: float, high: float) -> Array:
    return np.where((values >= low) & (values <= high), values, np.nan)


def _decibels(L: np.ndarray) -> Array:
    return np.asarray(20 * np.log10(np.maximum(np.abs(L), 1e-300)))


def _degrees(L: np.ndarray) -> Array:
    """Return the phase without jumps, in degrees, which begins within (-360, 0]."""
    phase = np.degrees(np.unwrap(np.angle(L)))
    return np.asarray(phase - 360 * np.ceil(phase[0] / 360))


class _Panel:
    """A panel with axes; its lines are drawn inside, with a mark of their style."""

    def __init__(self, width: float, height: float) -> None:
        self.width, self.height = width, height
        self.bottom = height - BOTTOM
        self.parts: list[str] = []
        self.y = Scale(0, 1, self.bottom, TOP)

    def decades(self, x: Scale, label: str = "") -> None:
        for power in range(int(np.ceil(x.low)), int(np.floor(x.high)) + 1):
            at = float(x(power))
            self.parts.append(f'<path class="grid" d="M{at:.1f} {TOP:g}V{self.bottom:g}"/>')
            self.parts.append(text(at, self.bottom + 14, f"{10.0**power:g}", "tick", "middle"))
        if label:
            middle = (LEFT + self.width) / 2
            self.parts.append(text(middle, self.height - 5, label, "tick", "middle"))

    def columns(self, x: Scale, ticks: Sequence[float]) -> None:
        for tick in ticks:
            at, style = float(x(tick)), "zero" if tick == 0 else "grid"
            self.parts.append(f'<path class="{style}" d="M{at:.1f} {TOP:g}V{self.bottom:g}"/>')
            self.parts.append(text(at, self.bottom + 14, _number(tick), "tick", "middle"))

    def rows(self, y: Scale, ticks: Sequence[float]) -> None:
        self.y = y
        for tick in ticks:
            at, style = float(y(tick)), "zero" if tick == 0 else "grid"
            self.parts.append(f'<path class="{style}" d="M{LEFT:g} {at:.1f}H{self.width - 14:g}"/>')
            self.parts.append(text(LEFT - 6, at + 3.5, _number(tick), "tick", "end"))

    def draw(self, lines: Iterable[tuple[str, Array, Array]]) -> None:
        for k, (style, x, y) in enumerate(lines):
            self.parts.append(path(x, y, f"line {style}"))
            self.mark(style, x, y, k)

    def mark(self, style: str, x: Array, y: Array, k: int) -> None:
        """Draw the style's mark at four points of a line, at other ones for each line."""
        inside = np.flatnonzero((x > LEFT) & (x < self.width - 14) & (y > TOP) & (y < self.bottom))
        shares = np.linspace(0.05 + 0.04 * k, 0.75 + 0.04 * k, 4)
        for i in inside[(shares * len(inside)).astype(int)] if len(inside) else []:
            self.dot(style, float(x[i]), float(y[i]), 0.8)

    def dot(self, style: str, x: float, y: float, size: float) -> None:
        place = f"translate({x:.1f} {y:.1f}) scale({size:g})"
        self.parts.append(f'<path class="{style} marker" d="{MARKS[style]}" transform="{place}"/>')

    def svg(self, title: str) -> str:
        return (
            f'<rect class="card" width="{self.width:.1f}" height="{self.height:.1f}" rx="9"/>'
            + text(14, 20, title, "heading")
            + "".join(self.parts)
        )


def _nyquist(panel: _Panel, lines: Sequence[tuple[str, Array, np.ndarray]]) -> None:
    """Draw L in the square around -1, and the unit circle."""
    high = panel.bottom - TOP
    wide = panel.width - 14 - LEFT
    reach = 1.5
    x = Scale(-0.5 - reach * wide / high, -0.5 + reach * wide / high, LEFT, panel.width - 14)
    y = Scale(-reach, reach, panel.bottom, TOP)
    panel.columns(x, nice_ticks(x.low, x.high, 5))
    panel.rows(y, nice_ticks(-reach, reach, 4))
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 181))
    panel.parts.append(path(x(circle.real), y(circle.imag), "line desired dash"))
    found = []
    for style, _, L in lines:
        inside = (L.real > x.low) & (L.real < x.high) & (np.abs(L.imag) < reach)
        px, py = np.where(inside, x(L.real), np.nan), np.where(inside, y(L.imag), np.nan)
        found.append((style, px, py))
    panel.draw(found)
    panel.parts.append(
        f'<path class="line sixth" d="M{float(x(-1)) - 6:.1f} {float(y(0)) - 6:.1f}'
        'l12 12m-12 0l12 -12"/>'
    )


def _poles(panel: _Panel, loops: Sequence[OpenedLoop]) -> None:
    """Draw the poles that are slower than ten times the fastest crossover."""
    fast = max(
        (o.margins.crossover for o in loops if np.isfinite(o.margins.crossover)), default=1.0
    )
    shown = [p[np.abs(p) < 3 * fast] for p in (o.closed_poles for o in loops)]
    every = np.concatenate([*shown, [-0.1 * fast + 0j]])
    x = Scale(1.08 * float(every.real.min()), max(0.08 * fast, 1.2 * float(every.real.max())),
              LEFT, panel.width - 14)  # fmt: skip
    tall = 1.1 * max(float(np.abs(every.imag).max()), 0.1 * fast)
    y = Scale(-tall, tall, panel.bottom, TOP)
    panel.columns(x, nice_ticks(x.low, x.high, 5))
    panel.rows(y, nice_ticks(-tall, tall, 5))
    for style, poles in zip(STYLES, shown, strict=False):
        for p in poles:
            panel.dot(style, float(x(p.real)), float(y(p.imag)), 0.9)


def _steps(panel: _Panel, loops: Sequence[OpenedLoop]) -> None:
    """Draw the step responses over one time."""
    seconds = max(loop.step()[0][-1] for loop in loops)
    found = [loop.step(seconds) for loop in loops]
    values = np.concatenate([np.clip(y, -10, 10) for _, y in found])
    low, high = min(0.0, float(values.min())), max(1.1, 1.05 * float(values.max()))
    x = Scale(0.0, seconds, LEFT, panel.width - 14)
    panel.columns(x, nice_ticks(0.0, seconds, 6))
    panel.rows(Scale(low, high, panel.bottom, TOP), nice_ticks(low, high, 4))
    every = [slice(None, None, max(1, len(t) // 800)) for t, _ in found]
    panel.draw((s, x(t[e]), panel.y(np.clip(y[e], low, high)))
               for s, (t, y), e in zip(STYLES, found, every, strict=False))  # fmt: skip


def _number(value: float) -> str:
    return f"{value:g}".replace("-", "−")
