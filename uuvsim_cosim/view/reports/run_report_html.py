"""The one-file report of a run: figures of merit, plots and provenance; opens offline."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from uuvsim_cosim.scene.mapping.mapping import SeabedMap
from uuvsim_cosim.view.plots.palette import page_styles
from uuvsim_cosim.view.plots.plots import Frame, Line, Panel, TimePanel
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.plots.track import VESSEL, Track
from uuvsim_cosim.view.recorded.metrics import Figure, figures
from uuvsim_cosim.view.recorded.traces import Array, Traces
from uuvsim_cosim.view.reports.panels import Section, lead_panels, sections, track_of
from uuvsim_cosim.view.reports.provenance import provenance_html
from uuvsim_cosim.view.reports.survey_map import map_figures, map_section
from uuvsim_cosim.view.scene3d.motion import motion_of
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.scene_html import MOMENTS, scene_html

__all__ = ["report_html"]

READOUTS = 900  # samples that the hover read-out can show


class _Page:
    """Panels as HTML, and the data of their read-outs, numbered as they are drawn."""

    def __init__(self, time: Array) -> None:
        self.time = time
        self.picks = np.unique(np.linspace(0, len(time) - 1, READOUTS).astype(int))
        self.series: list[dict[str, object]] = []

    def encoded(self, value: Array) -> str:
        data = np.asarray(value, dtype="<f4")
        return base64.b64encode(data.tobytes()).decode("ascii")

    def panel(self, panel: Panel, frame: Frame) -> str:
        keys = "".join(self._key(line) for line in panel.lines)
        if isinstance(panel, TimePanel):
            keys += "".join(
                f'<span class="key"><svg viewBox="0 0 18 9"><rect class="{band.style}" '
                f'width="18" height="9" rx="2"/></svg>{escape(band.label)}</span>'
                for band in panel.bands
            )
        return (
            f'<div class="card"><h3>{escape(panel.title)} '
            f'<span class="unit">{f"[{escape(panel.unit)}]" if panel.unit else ""}</span>'
            f'<span class="keys">{keys}</span></h3>'
            f'<svg viewBox="0 0 {frame.width:g} {frame.height:g}" data-x0="{frame.left:g}" '
            f'data-x1="{frame.width - frame.right:g}" role="img" '
            f'aria-label="{escape(panel.title)} over time">{panel.draw(self.time, frame)}'
            f'<line class="cursor" y1="{frame.top:g}" y2="{frame.height - frame.bottom:g}"/>'
            "</svg></div>"
        )

    def _key(self, line: Line) -> str:
        number = len(self.series)  # `data-s`, by which report.js finds the series
        self.series.append({"v": self.encoded(line.value[self.picks]), "d": line.digits})
        swatch = (
            ""
            if line.readout_only or line.style == "ahead"
            else '<svg viewBox="0 0 18 9"><path class="line thick '
            f'{line.style}{" dash" if line.dashed else ""}" d="M0 4.5H18"/></svg>'
        )
        return f'<span class="key">{swatch}{escape(line.label)}<b data-s="{number}"></b></span>'

    def section(self, section: Section) -> str:
        width = 560 if section.columns == 2 else 400
        frame = Frame(width=width, height=section.height)
        inside = "".join(self.panel(panel, frame) for panel in section.panels)
        return f'<h2>{escape(section.title)}</h2><div class="grid{section.columns}">{inside}</div>'

    def data(self, track: Track | None) -> str:
        content: dict[str, object] = {
            "time": self.encoded(self.time[self.picks]),
            "series": self.series,
        }
        if track is not None:
            x, y, _ = track.scales()
            content["track"] = {
                "x": self.encoded(x(track.eta[self.picks, 1])),
                "y": self.encoded(y(track.eta[self.picks, 0])),
                "turn": self.encoded(np.degrees(track.eta[self.picks, 5]) - 90.0),
            }
        return json.dumps(content, separators=(",", ":"))


def report_html(
    traces: Traces,
    provenance: Mapping[str, Any],
    scene3d: Scene3D | None = None,
    surveyed: SeabedMap | None = None,
) -> str:
    """Return the report as one HTML page; with a `stage` it has a scene in three dimensions.

    With the map of a survey, `surveyed`, it shows that as well. `provenance` is the content of
    run.json; all of its fields are optional.
    """
    waypoints = provenance.get("waypoints")
    path = None if waypoints is None else np.asarray(waypoints, dtype=float)
    page = _Page(traces.time)
    track = track_of(traces, path)
    name = str(provenance.get("system", "run"))
    body = [
        f"<header><h1>{escape(name)}</h1><p>{escape(_subtitle(traces, provenance))}</p>"
        '<button id="theme" type="button">light / dark</button></header>',
        _figures(
            [*(map_figures(surveyed) if surveyed else ()), *figures(traces, path)], provenance
        ),
    ]
    if track is not None:
        panels = "".join(
            page.panel(p, Frame(width=560, height=188)) for p in lead_panels(traces, path)
        )
        body.append(f'<div class="lead">{_track(track)}<div>{panels}</div></div>')
    if surveyed is not None:
        lines = {"truth": "hull.eta", "estimate": "navigation.eta"}
        found = {style: traces.vector(name, 2) for style, name in lines.items()}
        body.append(map_section(surveyed, {k: v for k, v in found.items() if v is not None}))
    if scene3d is not None:
        moments = MOMENTS // max(1, len(scene3d.bodies) // 4)
        body.append(scene_html(scene3d, motion_of(scene3d, traces, moments)))
    body += [page.section(section) for section in sections(traces)]
    body.append(provenance_html(provenance))
    script = files("uuvsim_cosim.view.reports").joinpath("report.js").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(name)} · uuvsim</title>\n<style>{page_styles()}</style></head>\n"
        f'<body><main>{"".join(body)}</main><div id="clock"></div>\n'
        f'<script id="data" type="application/json">{page.data(track)}</script>\n'
        f"<script>{script}</script></body></html>\n"
    )


def _subtitle(traces: Traces, provenance: Mapping[str, Any]) -> str:
    parts = [f"{float(traces.time[-1] - traces.time[0]):g} s simulated"]
    if "seed" in provenance:
        parts.append(f"seed {provenance['seed']}")
    factor = provenance.get("real_time_factor")
    if factor:
        parts.append(f"{factor:.0f} times real time")
    if provenance.get("interrupted"):
        parts.append(str(provenance["interrupted"]))
    return " · ".join(parts)


def _figures(found: Sequence[Figure], provenance: Mapping[str, Any]) -> str:
    tiles = "".join(
        f'<div class="figure"><span>{escape(f.label)}</span><b>{f.value:{f.form}}'
        f"<i>{escape(f.unit)}</i></b>{f'<small>{escape(f.note)}</small>' if f.note else ''}</div>"
        for f in found
        if np.isfinite(f.value)
    )
    return f'<div class="figures">{tiles}</div>' if tiles else ""


def _track(track: Track) -> str:
    _, _, height = track.scales()
    keys = [("line truth thick", "true")]
    keys += [("line estimate", "estimate")] if track.estimate is not None else []
    keys += [("line desired dash", "path")] if track.path is not None else []
    keys += [("current", "current")] if track.current is not None else []
    legend = "".join(
        f'<span class="key"><svg viewBox="0 0 18 9"><path class="{style}" d="M0 4.5H18'
        f'{"M13.5 2L18 4.5L13.5 7" if style == "current" else ""}"/></svg>{label}</span>'
        for style, label in keys
    )
    if track.fixes is not None:
        legend += (
            '<span class="key"><svg viewBox="0 0 18 9"><path class="fix" d="M9 4.5h.01"/></svg>'
            "USBL fixes</span>"
        )
    return (
        f'<div class="card"><h3>Track, seen from above<span class="keys">{legend}</span></h3>'
        f'<svg id="track" viewBox="0 0 {track.width:g} {height:.0f}" role="img" '
        f'aria-label="Track: north over east">{track.draw()}'
        f'<path class="here" d="{VESSEL}"/></svg></div>'
    )
