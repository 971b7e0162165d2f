"""The report that compares two runs in one file: both on the same axes, and their differences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import written
from uuvsim_cosim.view.plots.page import own_file, page_html
from uuvsim_cosim.view.plots.plots import Panel, TimePanel
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.recorded.metrics import figures
from uuvsim_cosim.view.recorded.traces import Traces, provenance_of
from uuvsim_cosim.view.reports.panels import Section, lead_panels, sections, track_of
from uuvsim_cosim.view.reports.provenance import FORMULAS, details_html, facts_of
from uuvsim_cosim.view.reports.run_report import (
    Plots,
    header_html,
    sampled_traces,
    track_html,
    waypoints_of,
)

__all__ = ["comparison_html", "write_comparison"]


def write_comparison(a: str | Path, b: str | Path, out: str | Path | None = None) -> Path:
    """Write the comparison of two runs, by default into A's folder; its name then holds B's."""
    place = Path(a) / f"compared_with_{Path(b).resolve().name}.html" if out is None else Path(out)
    runs = [sampled_traces(folder) for folder in (a, b)]
    names = [Path(folder).resolve().name for folder in (a, b)]
    page = comparison_html(runs, [provenance_of(folder) for folder in (a, b)], names)
    return written(place, page, make_folder=True)


def comparison_html(
    runs: Sequence[Traces], provenances: Sequence[Mapping[str, Any]], names: Sequence[str]
) -> str:
    """Return the comparison of runs A and B as one HTML page.

    B's lines are dashed and have hollow marks. Differences are B - A at A's times, B's samples
    being interpolated where its times differ.
    """
    plots = Plots(runs)
    paths = [waypoints_of(provenance) for provenance in provenances]
    tracks = [track_of(run, path) for run, path in zip(runs, paths, strict=True)]
    title = f"{names[0]} and {names[1]}"
    facts = " · ".join(
        f"{letter}: {provenance.get('system', 'run')}, {name}, {run.time[-1] - run.time[0]:g} s"
        for letter, name, run, provenance in zip("AB", names, runs, provenances, strict=True)
    )
    merits = [
        {f.key: f for f in figures(*pair) if np.isfinite(f.value)}
        for pair in zip(runs, paths, strict=True)
    ]
    rows = []
    for key in dict.fromkeys([*merits[0], *merits[1]]):
        a, b = merits[0].get(key), merits[1].get(key)
        known = a or b
        assert known is not None
        difference = f"{b.value - a.value:+{known.form}}" if a and b else ""
        values = [f"{f.value:{f.form}}" if f else "–" for f in (a, b)]
        rows.append((f"{known.label} [{known.unit}]", *values, difference))
    body = [
        header_html(title, facts),
        '<div class="card wide figure-table">'
        f"{_table(('', 'A', 'B', 'B − A'), rows, number=True)}</div>",
        plots.tools(),
    ]
    both = [(letter, track) for letter, track in zip("AB", tracks, strict=True) if track]
    if len(both) == 2:
        # One picture has one scale: A's picture is drawn around both, without A's estimate.
        first, second = (replace(t, estimate=None, fixes=None, current=None) for _, t in both)
        first = replace(first, other=second.eta)
        both = [("A", first), ("B", replace(second, other=first.eta, path=first.path))]
        body.append(f'<div class="compared first">{track_html(both)}</div>')
    else:
        both = []
    groups = [
        [Section("Mission", lead_panels(run, path)), *sections(run)]
        for run, path in zip(runs, paths, strict=True)
    ]
    for section in groups[0]:
        same = next((s for s in groups[1] if s.title == section.title), None)
        panels = [] if same is None else list(_compared(section.panels, same.panels, plots))
        if panels:
            body.append(plots.section(Section(section.title, panels)))
    settings = [dict(facts_of(provenance)) for provenance in provenances]
    shown = [
        (key, settings[0].get(key, "–"), settings[1].get(key, "–"))
        for key in dict.fromkeys([*settings[0], *settings[1]])
        if settings[0].get(key) != settings[1].get(key)
    ]
    signals = [set(run.values) for run in runs]
    only = [
        f"Only {letter} has the signals {', '.join(sorted(signals[k] - signals[1 - k]))}."
        for k, letter in enumerate("AB")
        if signals[k] - signals[1 - k]
    ]
    body += [
        "<h2>Differences in the settings</h2>",
        f'<div class="card wide">{_table(("", "A", "B"), shown)}</div>',
        details_html("How the figures are computed", (*FORMULAS, *only, plots.note())),
        "<footer>Written by uuvsim-cosim. This file needs no network.</footer>",
    ]
    return page_html(
        title, "uuvsim", body,
        style=own_file("uplot/uPlot.min.css"), scripts=plots.scripts(track for _, track in both),
    )  # fmt: skip


def _compared(a: Iterable[Panel], b: Iterable[Panel], plots: Plots) -> Iterable[Panel]:
    """Yield, for each panel of both runs, the lines of both, then their differences."""
    others = {panel.title: panel for panel in b}
    for panel in a:
        other = others.get(panel.title)
        if other is None:
            continue
        styles = ("truth", "estimate", "third", "fourth", "fifth", "sixth", "seventh", "desired")
        alone = len({line.style for line in panel.lines}) < len(panel.lines)  # rows of one style
        lines = [
            replace(
                line,
                label=f"{letter} {line.label}",
                style=styles[k % len(styles)] if alone else line.style,
                dashed=run == 1,
                run=run,
            )
            for run, letter, lines in ((0, "A", panel.lines), (1, "B", other.lines))
            for k, line in enumerate(lines)
        ]
        options = (
            {"down": panel.down, "include": panel.include, "least_span": panel.least_span}
            if isinstance(panel, TimePanel)
            else {"include": [0.0]}
        )
        yield TimePanel(panel.title, panel.unit, lines, **options)
        yield plots.difference(TimePanel(panel.title, panel.unit, lines))


def _table(head: Sequence[str], rows: Iterable[Sequence[object]], *, number: bool = False) -> str:
    style = ' class="number"' if number else ""
    cells = "".join(
        f"<tr><th>{escape(row[0])}</th>"
        + "".join(f"<td{style}>{escape(cell)}</td>" for cell in row[1:])
        + "</tr>"
        for row in rows
    )
    titles = "".join(f"<th{style}>{escape(title)}</th>" for title in head)
    return f"<table><thead><tr>{titles}</tr></thead><tbody>{cells}</tbody></table>"
