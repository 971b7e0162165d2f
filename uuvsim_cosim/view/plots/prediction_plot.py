"""Picture of predictions of a recording: errors over the horizon, and a stretch of each signal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.view.plots.page import MARKS, picture_styles
from uuvsim_cosim.view.plots.svg import Scale, nice_ticks, path, text
from uuvsim_cosim.view.recorded.traces import Array

__all__ = ["Predicted", "prediction_picture"]

WIDTH, HEAD, PAD, GAP, HEIGHT = 1000.0, 62.0, 16.0, 14.0, 190.0
SHARE, LEFT, BOTTOM, TOP = 0.34, 56.0, 34.0, 30.0
STYLES = ("truth", "desired", "third", "estimate")


@dataclass(frozen=True)
class Predicted:
    """A signal: errors (value, low, high) of each predictor over horizons, and a stretch.

    `errors` and `predicted` are by the same names; `predicted` at `t` were made `before` seconds
    earlier. NaN breaks a line.
    """

    label: str
    unit: str
    ahead: Array
    errors: Mapping[str, Array]  # (n, 3)
    t: Array
    measured: Array
    predicted: Mapping[str, Array]
    before: float


def prediction_picture(signals: Sequence[Predicted], title: str) -> str:
    """Return the picture as SVG: a row for each signal, one legend."""
    names = list(signals[0].errors)
    body = ""
    left = SHARE * (WIDTH - 2 * PAD)
    right = WIDTH - 2 * PAD - GAP - left
    for i, signal in enumerate(signals):
        y = HEAD + i * (HEIGHT + GAP)
        body += f'<g transform="translate({PAD:g} {y:g})">{_errors(signal, names, left)}</g>'
        x = PAD + left + GAP
        body += f'<g transform="translate({x:.1f} {y:g})">{_stretch(signal, names, right)}</g>'
    keys, at = "", PAD + 2
    for name, style in (*zip(names, STYLES, strict=False), ("measured", "measured")):
        line = "axis measured" if name == "measured" else f"line {style}"
        keys += f'<path class="{line}" d="M{at:.0f} 44h20"/>'
        if name != "measured":
            keys += f'<path class="{style} marker" d="{MARKS.get(style, "")}" ' + (
                f'transform="translate({at + 10:.0f} 44)"/>'
            )
        keys += text(at + 26, 48, name, "tick")
        at += 6.4 * len(name) + 48
    height = HEAD + len(signals) * (HEIGHT + GAP) + PAD - GAP
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height:g}" '
        f'width="{WIDTH:g}" height="{height:g}" role="img"><style>{picture_styles()}'
        ".measured{stroke:#13202f;stroke-width:2.6;fill:none;opacity:.35}</style>"
        f'<rect class="page" width="{WIDTH:g}" height="{height:g}" rx="12"/>'
        + text(PAD + 2, 26, title, "heading")
        + keys
        + body
        + "</svg>\n"
    )


def _errors(signal: Predicted, names: Sequence[str], width: float) -> str:
    """Draw RMS errors over the horizon, both axes logarithmic, with intervals."""
    every = np.concatenate([signal.errors[n].ravel() for n in names])
    every = every[np.isfinite(every) & (every > 0)]
    low, high = float(every.min()), float(np.minimum(every.max(), 300 * every.min()))
    sx = Scale(np.log10(signal.ahead[0] / 1.3), np.log10(signal.ahead[-1] * 1.3), LEFT, width - 12)
    sy = Scale(np.log10(low / 1.3), np.log10(high * 1.3), HEIGHT - BOTTOM, TOP)
    parts = [text(LEFT, 16, f"RMS error, {signal.label} [{signal.unit}]", "label")]
    for ahead in signal.ahead:
        x = float(sx(np.log10(ahead)))
        parts.append(f'<path class="grid" d="M{x:.1f} {TOP:g}V{HEIGHT - BOTTOM:g}"/>')
        parts.append(text(x, HEIGHT - BOTTOM + 14, f"{ahead:g}", "tick", "middle"))
    for tick in _decades(low / 1.3, high * 1.3):
        y = float(sy(np.log10(tick)))
        parts.append(f'<path class="grid" d="M{LEFT:g} {y:.1f}H{width - 12:.1f}"/>')
        parts.append(text(LEFT - 6, y + 3.5, f"{tick:g}", "tick", "end"))
    parts.append(text((LEFT + width) / 2, HEIGHT - 4, "ahead [s]", "tick", "middle"))
    for i, (name, style) in enumerate(zip(names, STYLES, strict=False)):
        places = sx(np.log10(signal.ahead)) + 3.0 * (i - 1.5)
        values = np.clip(signal.errors[name], low / 1.25, high * 1.25)
        heights = sy(np.log10(values))
        parts.append(path(places, heights[:, 0], f"line {style}"))
        for at, (middle, bottom, top) in zip(places.tolist(), heights.tolist(), strict=True):
            if np.isfinite(top):
                parts.append(f'<path class="line {style}" d="M{at:.1f} {bottom:.1f}V{top:.1f}"/>')
            if np.isfinite(middle):
                parts.append(
                    f'<path class="marker {style}" d="{MARKS.get(style, "")}" '
                    f'transform="translate({at:.1f} {middle:.1f})"/>'
                )
    return "".join(parts)


def _stretch(signal: Predicted, names: Sequence[str], width: float) -> str:
    """Draw a stretch of the signal, and what was predicted of each point."""
    seen = np.concatenate([signal.measured, signal.predicted[names[0]]])
    seen = seen[np.isfinite(seen)]
    pad = 0.15 * (float(seen.max() - seen.min()) or 1.0)
    low, high = float(seen.min()) - pad, float(seen.max()) + pad
    sx = Scale(float(signal.t[0]), float(signal.t[-1]), LEFT, width - 12)
    sy = Scale(low, high, HEIGHT - BOTTOM, TOP)
    label = f"{signal.label} [{signal.unit}] over time [s], predicted {signal.before:g} s before"
    parts = [text(LEFT, 16, label, "label")]
    for tick in nice_ticks(sx.low, sx.high, 6):
        x = float(sx(tick))
        parts.append(f'<path class="grid" d="M{x:.1f} {TOP:g}V{HEIGHT - BOTTOM:g}"/>')
        parts.append(text(x, HEIGHT - BOTTOM + 14, f"{tick:g}", "tick", "middle"))
    for tick in nice_ticks(low, high, 4):
        y = float(sy(tick))
        parts.append(f'<path class="grid" d="M{LEFT:g} {y:.1f}H{width - 12:.1f}"/>')
        parts.append(text(LEFT - 6, y + 3.5, f"{tick:g}".replace("-", "−"), "tick", "end"))
    for name, style in zip(names, STYLES, strict=False):
        values = np.where(
            (signal.predicted[name] >= low) & (signal.predicted[name] <= high),
            signal.predicted[name], np.nan,
        )  # fmt: skip
        parts.append(path(sx(signal.t), sy(values), f"line {style}"))
    parts.append(path(sx(signal.t), sy(signal.measured), "measured"))
    return "".join(parts)


def _decades(low: float, high: float) -> list[float]:
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [m * 10.0**p for p in powers for m in (1.0, 2.0, 5.0)]
    return [t for t in ticks if low <= t <= high]
