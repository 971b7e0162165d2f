"""The map of a survey in a report: depth in shaded colours, errors by pose, and the track."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.view.plots.png import Pixels, png
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.recorded.metrics import Figure
from uuvsim_cosim.view.recorded.traces import Array

if TYPE_CHECKING:
    from uuvsim_cosim.scene.mapping.mapping import SeabedMap

__all__ = ["map_figures", "map_pictures", "map_section"]

WIDEST = 300  # pixels of a picture
LEVELS = 32  # colours, so that pictures stay small
NAMES = {"true": "true pose", "navigation": "navigation's pose"}
DEPTHS = np.array([[253, 231, 150], [148, 210, 150], [48, 150, 160], [33, 86, 140], [20, 30, 84]])
ERRORS = np.array([[33, 86, 172], [146, 190, 222], [244, 244, 242], [244, 168, 110], [178, 60, 20]])
NOTHING = np.array([128, 136, 146])


def map_figures(made: SeabedMap) -> list[Figure]:
    """Return the figures of merit of a map."""
    found = []
    for f in made.figures:
        note = f"bias {100 * f.bias:+.2f} cm, 95 % within {100 * f.p95:.1f} cm"
        found.append(Figure(f"map_{f.pose}", f"map RMSE, {NAMES.get(f.pose, f.pose)}",
                            100 * f.rmse, "cm", ".2f", note))  # fmt: skip
    cells = made.figures[0].cells
    of = f"{made.frames:,} frames, {made.seconds:.1f} s of CPU; {cells:,} cells of "
    found.append(Figure("map_points", "points in the map", made.points / 1e6, "million", ".2f",
                        f"{of}{made.window.cell:g} m"))  # fmt: skip
    return found


def map_pictures(made: SeabedMap) -> dict[str, tuple[Pixels, str]]:
    """Return pictures (rows, columns, 3), north up, by name, each with its colours' meaning."""
    block = max(1, -(-made.window.columns // WIDEST))
    true = _coarse(next(iter(made.depth.values())), block)
    low, high = (float(np.nanpercentile(true, q)) for q in (1, 99))
    share = (true - low) / max(high - low, 1e-9)
    slope = np.gradient(np.nan_to_num(true, nan=float(np.nanmean(true))))
    light = np.clip(1.0 + 0.35 * (slope[0] + slope[1]) / (block * made.window.cell), 0.7, 1.15)
    depth = np.clip(_coloured(share, DEPTHS) * light[..., None], 0, 255).astype(np.uint8)
    depth[~np.isfinite(true)] = NOTHING
    found = {"depth": (depth[::-1], f"{low:.1f} m (light) to {high:.1f} m (dark)")}
    for pose, z in made.depth.items():
        error = _coarse(z - made.truth, block)
        seen = np.abs(error[np.isfinite(error)])
        most = float(np.percentile(seen, 98)) if seen.size else 1.0
        picture = _coloured(0.5 + 0.5 * error / max(most, 1e-9), ERRORS).astype(np.uint8)
        picture[~np.isfinite(error)] = NOTHING
        words = f"{-100 * most:.1f} cm (blue: too high) to {100 * most:+.1f} cm (red: too deep)"
        found[f"error, {NAMES.get(pose, pose)}"] = (picture[::-1], words)
    return found


def map_section(made: SeabedMap, tracks: Mapping[str, Array]) -> str:
    """Return the section of a report; `tracks` are N and E (n, 2) by style of line."""
    cards = []
    for name, (pixels, words) in map_pictures(made).items():
        data = base64.b64encode(png(np.ascontiguousarray(pixels))).decode("ascii")
        w, over = made.window, ""
        width, height = w.columns * w.cell, w.rows * w.cell
        for style, some in tracks.items() if name == "depth" else ():
            at = "L".join(
                f"{east - w.east:.2f} {w.north + height - north:.2f}" for north, east in some
            )
            over += (f'<path class="line {style}" vector-effect="non-scaling-stroke" fill="none" '
                     f'd="M{at}"/>')  # fmt: skip
        length = 10.0 ** np.floor(np.log10(max(width / 3.0, 1e-3)))  # of the ruler
        y, size = height - 0.03 * height, 0.032 * width
        ruler = (
            f'<path d="M{0.03 * width:.2f} {y:.2f}h{length:g}" stroke="#fff" fill="none" '
            f'stroke-width="{0.006 * width:.3f}"/><text x="{0.03 * width:.2f}" '
            f'y="{y - 0.35 * size:.2f}" style="fill:#fff;font-size:{size:.2f}px">{length:g} m'
            "</text>"
        )
        cards.append(
            f'<div class="card"><h3>Map: {escape(name)}<span class="keys">{escape(words)}</span>'
            f'</h3><svg viewBox="0 0 {width:.1f} {height:.1f}" role="img" '
            f'aria-label="Map: {escape(name)}"><image width="{width:.1f}" height="{height:.1f}" '
            f'preserveAspectRatio="none" style="image-rendering:pixelated" '
            f'href="data:image/png;base64,{data}"/>{over}{ruler}</svg></div>'
        )
    sensors = "; ".join(made.sensors)
    about = (
        f"{made.frames:,} frames, {made.points:,} points ({sensors}) in cells of "
        f"{made.window.cell:g} m; scene {made.scene}. North is up. Not for navigation."
    )
    return (
        f'<h2>Map of the seabed</h2><div class="grid3">{"".join(cards)}</div>'
        f'<p style="color:var(--muted);font-size:12.5px">{escape(about)}</p>'
    )


def _coarse(z: Array, block: int) -> Array:
    """Return means over blocks of cells; NaN where a block has no cell with a value."""
    if block == 1:
        return z
    rows, columns = (-(-n // block) for n in z.shape)
    padded = np.full((rows * block, columns * block), np.nan)
    padded[: z.shape[0], : z.shape[1]] = z
    parts = padded.reshape(rows, block, columns, block)
    count = np.isfinite(parts).sum(axis=(1, 3))
    total = np.nansum(parts, axis=(1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _coloured(share: Array, ramp: Array) -> Array:
    at = np.clip(np.nan_to_num(share), 0.0, 1.0)
    at = np.round(at * (LEVELS - 1)) / (LEVELS - 1) * (len(ramp) - 1)
    i = np.minimum(at.astype(int), len(ramp) - 2)
    coloured: Array = ramp[i] + (at - i)[..., None] * (ramp[i + 1] - ramp[i])
    return coloured
