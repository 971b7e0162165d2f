"""The one-file report of a run: figures of merit, plots and provenance; opens offline.

uPlot draws the plots over time; `report.js` lets a reader zoom, read values and add signals.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.cache import written
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.live_page.run_page import PAGE, write_run_page
from uuvsim_cosim.view.plots.page import MARKS, encoded, key_html, own_file, page_html
from uuvsim_cosim.view.plots.plots import Line, Panel, Rows, TimePanel
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.plots.track import VESSEL, Track
from uuvsim_cosim.view.recorded.metrics import figures
from uuvsim_cosim.view.recorded.traces import Array, Traces, provenance_of, traces_of
from uuvsim_cosim.view.reports.again import again_html
from uuvsim_cosim.view.reports.page_data import (
    MOST_ELEMENTS,
    PANEL_BINS,
    Bins,
    coded,
    signal_bins,
)
from uuvsim_cosim.view.reports.panels import STYLES, Section, lead_panels, sections, track_of
from uuvsim_cosim.view.reports.provenance import provenance_html
from uuvsim_cosim.view.reports.sonar_section import sonar_section
from uuvsim_cosim.view.reports.survey_map import map_figures, map_section
from uuvsim_cosim.view.scene3d.motion import motion_of
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.scene_html import MOMENTS, scene_html
from uuvsim_cosim.view.scene3d.scene_of_run import scene3d_of_run

if TYPE_CHECKING:
    from uuvsim_cosim.scene.mapping.mapping import SeabedMap

__all__ = [
    "Plots",
    "header_html",
    "report_html",
    "sampled_traces",
    "track_html",
    "waypoints_of",
    "write_report",
]

POINTS = 900  # of a track: those to which the vehicle's symbol moves


class Plots:
    """The plots of a page as HTML, and the data from which the page's script draws them.

    `runs` are one run, or the two of a comparison, which share all time axes.
    """

    def __init__(self, runs: Sequence[Traces]) -> None:
        self.runs = runs
        names = sorted({name for run in runs for name in run.values})
        signals, self.left_out = signal_bins(runs, names)
        self.names = [name for name in names if name not in self.left_out]
        self._bins = [Bins([run.time for run in runs], PANEL_BINS), signals]
        self._columns: list[dict[str, object]] = []
        self._panels: list[dict[str, object]] = []

    def card(self, panel: Panel) -> str:
        """Return the card of a panel; the script draws into it."""
        number = len(self._panels)
        self._panels.append(self._data(panel, 0))
        unit = f"[{escape(panel.unit)}]" if panel.unit not in ("", "1") else ""
        tall = " rows" if isinstance(panel, Rows) else ""
        return (
            f'<div class="card" data-plot="{number}"><h3>{escape(panel.title)} '
            f'<span class="unit">{unit}</span><span class="keys"></span></h3>'
            f'<div class="plot{tall}"></div></div>'
        )

    def section(self, section: Section, kind: str = "") -> str:
        """Return a heading and the cards below it; `kind` is a class of the page's style."""
        inside = "".join(self.card(panel) for panel in section.panels)
        return (
            f'<section class="{kind}"><h2>{escape(section.title)}</h2>'
            f'<div class="grid{section.columns}">{inside}</div></section>'
        )

    def tools(self) -> str:
        """Return the tools: zoom of all plots, and the field that adds a recorded signal."""
        names = "".join(f'<option value="{escape(name)}">' for name in self.names)
        buttons = "".join(
            f'<button type="button" data-zoom="{act}" aria-label="{label}">{sign}</button>'
            for act, sign, label in (
                ("back", "◀", "earlier"), ("in", "+", "zoom in"), ("out", "−", "zoom out"),
                ("on", "▶", "later"), ("all", "whole run", "show the whole run"),
            )
        )  # fmt: skip
        return (
            '<div class="tools"><label>Plot a signal <input id="search" list="signals" '
            f'type="search" placeholder="{escape(next(iter(self.names), ""))}" size="26"></label>'
            f'<datalist id="signals">{names}</datalist>{buttons}<small id="hint" role="status">'
            "Drag over a plot to zoom, double-click for the whole run; click a legend entry to "
            'hide a line.</small></div><div id="added" class="grid2"></div>'
        )

    def note(self) -> str:
        """Return the sentence on the recorded signals in the page, for the section of formulas."""
        bins = self._bins[1]
        kept = (
            "with all samples"
            if bins.exact
            else f"as the least and greatest sample of {len(bins.edges) - 1} intervals of "
            f"{bins.edges[1] - bins.edges[0]:.3g} s"
        )
        text = f"The page holds {len(self.names)} recorded signals {kept}; values have 16 bits."
        if self.left_out:
            names = ", ".join(self.left_out[:20]) + (", …" if len(self.left_out) > 20 else "")
            text += (
                f" {len(self.left_out)} signals are only in the recording, as they have more than "
                f"{MOST_ELEMENTS} elements or do not fit into the page: {names}."
            )
        return text

    def scripts(self, tracks: Iterable[Track]) -> str:
        """Return the data and the scripts of the page."""
        found = []
        for track in tracks:
            picks = np.unique(np.linspace(0, len(track.time) - 1, POINTS).astype(int))
            x, y, _ = track.scales()
            values = {  # of the vehicle's symbol: pixels, and its turn [deg]
                "time": track.time[picks],
                "x": x(track.eta[picks, 1]),
                "y": y(track.eta[picks, 0]),
                "turn": np.degrees(track.eta[picks, 5]) - 90.0,
            }
            found.append({name: encoded(value.astype("<f4")) for name, value in values.items()})
        content = {
            "marks": MARKS,
            "panels": self._panels,
            "signals": {name: self._signal(name) for name in self.names},
            "columns": self._columns,
            "times": [
                {"start": float(b.x[0]), "t": encoded((b.x - b.x[0]).astype("<f4"))}
                for b in self._bins
            ],
            "tracks": found,
        }
        text = json.dumps(content, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
        licence = own_file("uplot/LICENSE").strip()
        library = own_file("uplot/uPlot.iife.min.js").partition("\n")[2]  # without its address
        own = files("uuvsim_cosim.view.reports").joinpath("report.js").read_text(encoding="utf-8")
        return (
            f'<div id="clock"></div>\n<script id="data" type="application/json">{text}</script>\n'
            f"<script>/* uPlot 1.6.32\n{licence}\n*/\n{library}</script>\n<script>{own}</script>"
        )

    def _data(self, panel: Panel, grid: int) -> dict[str, object]:
        """Return a panel as `report.js` reads it; `grid` 1 has the times of recorded signals."""

        def column(samples: Array) -> int:
            self._columns.append(coded(samples))
            return len(self._columns) - 1

        bins = self._bins[grid]
        panel = replace(
            panel,
            lines=[replace(line, value=bins.of(line.value, line.run)) for line in panel.lines],
        )
        if isinstance(panel, TimePanel):
            bands = [
                replace(band, low=bins.of(band.low), high=bins.of(band.high))
                for band in panel.bands
            ]
            panel = replace(panel, bands=bands)
        found: dict[str, object] = {
            "title": panel.title,
            "unit": "" if panel.unit == "1" else panel.unit,
            "grid": grid,
            "lines": [
                {"label": line.label, "column": column(np.asarray(line.value)), "run": line.run,
                 "style": "truth" if isinstance(panel, Rows) else line.style,
                 "digits": line.digits, "dash": line.dashed}
                for line in panel.lines
            ],
        }  # fmt: skip
        if isinstance(panel, TimePanel):
            found |= {"down": panel.down, "include": list(panel.include), "span": panel.least_span}
            found["bands"] = [
                {
                    "label": b.label,
                    "low": column(np.asarray(b.low)),
                    "high": column(np.asarray(b.high)),
                }
                for b in panel.bands
            ]
            if panel.bands:
                found["reach"] = panel.limits()
        elif isinstance(panel, Rows):
            found["rows"] = panel.reach()
        return found

    def _signal(self, name: str) -> list[dict[str, object]]:
        """Return the panels of a recorded signal: one for each unit, then differences B - A."""
        found = []
        having = [(k, run) for k, run in enumerate(self.runs) if name in run.values]
        for unit, elements in having[0][1].by_unit(name, len(STYLES)):
            lines = []
            for k, run in having:
                size = run.size(name)
                for style, i in zip(STYLES, elements, strict=False):
                    if i < size:
                        label = f"[{i + 1}]" if size > 1 else name.rpartition(".")[2]
                        if len(self.runs) > 1:
                            label = f"{'AB'[k]} {label}"
                        lines.append(Line(label, run.element(name, i), style, -1, k == 1, k))
            panel = TimePanel(name, unit, lines)
            found.append(self._data(panel, 1))
            if len(having) == 2:
                found.append(self._data(self.difference(panel), 1))
        return found

    def difference(self, panel: Panel) -> TimePanel:
        """Return the differences B - A of the lines "A x" and "B x" of a panel, at A's times."""
        first, second = self.runs[0].time, self.runs[1].time
        others = {line.label[2:]: line.value for line in panel.lines if line.run}
        lines = []
        for line in panel.lines:
            other = others.get(line.label[2:])
            if line.run == 0 and other is not None:
                if np.array_equal(first, second):
                    other = np.asarray(other)
                else:
                    other = np.interp(first, second, np.asarray(other), left=np.nan, right=np.nan)
                difference = other - np.asarray(line.value)
                lines.append(Line(line.label[2:], difference, line.style, line.digits))
        return TimePanel(f"{panel.title}: B − A", panel.unit, lines, include=[0.0])


def write_report(folder: str | Path, out: str | Path | None = None, *, page: bool = False) -> Path:
    """Write the one-file report of a run, by default report.html in its folder.

    With `page`, page.html, on which the run goes on from any instant, is written beside the report;
    raises SystemInvalid if a component prevents it.
    """
    traces = sampled_traces(folder)
    target = Path(out) if out is not None else Path(folder) / "report.html"
    if page:
        write_run_page(folder, target.parent / PAGE)
    from uuvsim_cosim.scene.mapping.mapping import read_map

    surveyed = read_map(Path(folder))
    provenance = provenance_of(folder)
    text = report_html(
        traces,
        provenance,
        scene3d_of_run(folder, traces),
        surveyed,
        again_html(Path(folder), provenance, target.parent / PAGE),
        sonar_section(Path(folder), traces),
    )
    return written(target, text, make_folder=True)


def sampled_traces(folder: str | Path) -> Traces:
    """Return the signals of a run; raises InputInvalid if it has fewer than two samples."""
    traces = traces_of(folder)
    if len(traces.time) < 2:
        raise InputInvalid(folder, f"{len(traces.time)} sample(s) recorded", "2 or more")
    return traces


def report_html(
    traces: Traces,
    provenance: Mapping[str, Any],
    scene3d: Scene3D | None = None,
    surveyed: SeabedMap | None = None,
    again: str = "",
    sonar: str = "",
) -> str:
    """Return the report as one HTML page; with `scene3d`, it has a scene in three dimensions.

    With the map of a survey, `surveyed`, it shows that as well. `provenance` is the content of
    run.json; all of its fields are optional. `again` is the section on the page that goes on,
    `sonar` that of the images of sonars.
    """
    path = waypoints_of(provenance)
    plots = Plots([traces])
    track = track_of(traces, path)
    name = str(provenance.get("system", "run"))
    facts = [f"{float(traces.time[-1] - traces.time[0]):g} s simulated"]
    if "seed" in provenance:
        facts.append(f"seed {provenance['seed']}")
    if provenance.get("real_time_factor"):
        facts.append(f"{provenance['real_time_factor']:.0f} times real time")
    if provenance.get("interrupted"):
        facts.append(str(provenance["interrupted"]))
    merits = [*(map_figures(surveyed) if surveyed else ()), *figures(traces, path)]
    tiles = "".join(
        f'<div class="figure"><span>{escape(f.label)}</span><b>{f.value:{f.form}}'
        f"<i>{escape(f.unit)}</i></b>{f'<small>{escape(f.note)}</small>' if f.note else ''}</div>"
        for f in merits
        if np.isfinite(f.value)
    )
    body = [header_html(name, " · ".join(facts)), f'<div class="figures">{tiles}</div>']
    body += [again, plots.tools()]
    # A narrow screen shows the class `first` before the figures of merit.
    if track is not None:
        panels = "".join(plots.card(p) for p in lead_panels(traces, path))
        body.append(f'<div class="lead first">{track_html([("", track)])}<div>{panels}</div></div>')
    if surveyed is not None:
        lines = {"truth": "hull.eta", "estimate": "navigation.eta"}
        rows = np.arange(0, len(traces.time), max(1, len(traces.time) // 600))
        found = {style: traces.elements(name, 2) for style, name in lines.items()}
        tracks = {k: v.stacked(0, 1, rows=rows) for k, v in found.items() if v is not None}
        body.append(map_section(surveyed, tracks))
    if scene3d is not None:
        moments = MOMENTS // max(1, len(scene3d.bodies) // 4)
        body.append(scene_html(scene3d, motion_of(scene3d, traces, moments)))
    body.append(sonar)
    for k, section in enumerate(sections(traces)):
        body.append(plots.section(section, "first" if track is None and k == 0 else ""))
    body.append(provenance_html(provenance, plots.note()))
    scripts = plots.scripts([] if track is None else [track])
    style = own_file("uplot/uPlot.min.css")
    return page_html(name, "uuvsim", body, style=style, scripts=scripts)


def header_html(title: str, subtitle: str) -> str:
    """Return the heading of a page with the button that changes its colours."""
    return (
        f"<header><h1>{escape(title)}</h1><p>{escape(subtitle)}</p>"
        '<button id="theme" type="button">light / dark</button></header>'
    )


def waypoints_of(provenance: Mapping[str, Any]) -> Array | None:
    """Return the planned path (n, 3) [m] of a run, if it has one."""
    waypoints = provenance.get("waypoints")
    return None if waypoints is None else np.asarray(waypoints, dtype=float)


def track_html(tracks: Sequence[tuple[str, Track]]) -> str:
    """Return the card of one track, or of a comparison's two with their labels "A" and "B"."""
    first = tracks[0][1]
    _, _, height = first.scales()
    keys = [
        key_html("truth", label or "true", mark=VESSEL) if k == 0 else key_html("estimate", label)
        for k, (label, _) in enumerate(tracks)
    ]
    if len(tracks) == 1 and first.estimate is not None:
        keys.append(key_html("estimate", "estimate"))
    if first.path is not None:
        circle = '<circle class="waypoint" cx="11" cy="5" r="3"/>'
        keys.append(key_html("desired", "path", dashed=True).replace("</svg>", f"{circle}</svg>"))
    if first.current is not None:
        keys.append(key_html("current", "current", line="M0 5H20M15 2L20 5L15 8", mark=""))
    if first.fixes is not None:
        keys.append(key_html("fix", "USBL fixes", line="M5 5h.01M17 5h.01", mark=""))
    here = "".join(f'<path class="here {"AB"[k]}" d="{VESSEL}"/>' for k in range(len(tracks)))
    return (
        f'<div class="card"><h3>Track, seen from above<span class="keys">{"".join(keys)}</span>'
        f'</h3><svg id="track" viewBox="0 0 {first.width:g} {height:.0f}" role="img" '
        f'aria-label="Track: north over east">{first.draw()}{here}</svg></div>'
    )
