"""A run as one static SVG for a README or a paper: the report's panels, without its scripts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import written
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.plots.page import MARKS, picture_styles
from uuvsim_cosim.view.plots.plots import Frame, Rows
from uuvsim_cosim.view.plots.svg import text
from uuvsim_cosim.view.plots.track import VESSEL
from uuvsim_cosim.view.recorded.metrics import figures
from uuvsim_cosim.view.recorded.traces import Traces, provenance_of
from uuvsim_cosim.view.reports.panels import lead_panels, sections, track_of
from uuvsim_cosim.view.reports.run_report import sampled_traces, waypoints_of

__all__ = ["picture_svg", "write_run_picture"]

WIDTH, GAP, MARGIN, HEAD = 1200.0, 14.0, 18.0, 30.0


def write_run_picture(folder: str | Path, out: str | Path) -> Path:
    """Write a run as one static SVG, for a README or a paper."""
    page = picture_svg(sampled_traces(folder), provenance_of(folder))
    return written(Path(out), page, make_folder=True)


def picture_svg(traces: Traces, provenance: Mapping[str, Any]) -> str:
    """Return the picture: key figures, the track, and four panels over time beside it."""
    path = waypoints_of(provenance)
    track = track_of(traces, path)
    if track is None:
        raise InputInvalid("the run has no signal hull.eta", "a vehicle's mission")
    left = 640.0
    track = replace(track, width=left - 24, tallest=560)
    _, _, track_height = track.scales()
    below = {s.title: list(islice(s.panels, 1)) for s in sections(traces)}
    extra = below.get("Thrust", [])
    navigation = [
        replace(p, title=f"Navigation error, {p.title.lower()}, and ±3 σ")
        for title, shown in below.items()
        if title.startswith("Nav")
        for p in shown
    ]
    panels = [*islice(lead_panels(traces, path), 2), *navigation, *extra][:4]
    tall = track_height + HEAD + 16
    top = 62.0
    shown = ("cross_track_rms", "cross_track_max", "navigation_horizontal_rms", "energy")
    key_figures = [f"{f.label} {f}" for f in figures(traces, path) if f.key in shown]
    parts = [
        f'<text x="{MARGIN + 2}" y="27" class="ink" style="font-size:18px;font-weight:650">'
        f"{provenance.get('system', 'run')}</text>",
        text(MARGIN + 2, 48, "   ·   ".join(key_figures), "tick"),
    ]
    keys, x = "", 0.0
    entries = [("current", "current"), ("line estimate", "estimate"), ("line truth thick", "true"),
               ("line desired dash", "path")]  # fmt: skip
    marks = {
        "estimate": ("estimate marker", MARKS["estimate"]),
        "true": ("vessel", VESSEL),
        "path": ("waypoint", MARKS["truth"]),
    }
    for style, label in entries:
        if label != "estimate" or track.estimate is not None:
            x -= 6.2 * len(label) + 26
            keys += f'<path class="{style}" d="M{x:.0f} -4h16"/>' + text(x + 21, 0, label, "tick")
            if label in marks:
                kind, mark = marks[label]
                place = f"translate({x + 8:.0f} -4) scale(.8)"
                keys += f'<path class="{kind}" d="{mark}" transform="{place}"/>'
    title = "Track, seen from above [m]"
    parts.append(_card(MARGIN, top, left, tall, title, track.draw(), keys))
    right = WIDTH - left - GAP - 2 * MARGIN
    shares = np.array([1.7 if isinstance(panel, Rows) else 1.0 for panel in panels])
    heights = (tall - GAP * (len(panels) - 1)) * shares / shares.sum()
    y = top
    for panel, each in zip(panels, heights, strict=True):
        frame = Frame(width=right - 24, height=each - HEAD - 10, bottom=20, top=4)
        title = f"{panel.title} [{panel.unit}]"
        inside = panel.draw(traces.time, frame)
        parts.append(_card(MARGIN + left + GAP, y, right, each, title, inside, ""))
        y += each + GAP
    height = top + tall + MARGIN
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height:.0f}" '
        f'width="{WIDTH:g}" height="{height:.0f}"><style>{picture_styles()}</style>'
        f'<rect class="page" width="{WIDTH:g}" height="{height:.0f}" rx="14"/>'
        + "".join(parts)
        + "</svg>\n"
    )


def _card(x: float, y: float, w: float, h: float, title: str, inside: str, keys: str) -> str:
    return (
        f'<g transform="translate({x:.1f} {y:.1f})">'
        f'<rect class="card" width="{w:.1f}" height="{h:.1f}" rx="10"/>'
        + text(14, 20, title, "heading")
        + f'<g transform="translate({w - 14:.1f} 20)">{keys}</g>'
        + f'<g transform="translate(12 {HEAD:g})">{inside}</g></g>'
    )
