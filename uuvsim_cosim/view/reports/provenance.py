"""Provenance of a run as HTML: version, seed, changes, components, notes and formulas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from uuvsim_cosim.view.plots.svg import escape

__all__ = ["FORMULAS", "details_html", "facts_of", "provenance_html"]

SHOWN = (
    ("system", "System"),
    ("source", "Source"),
    ("version", "uuvsim-cosim"),
    ("seed", "Seed"),
    ("backend", "Components run as"),
    ("until", "Until [s]"),
    ("tick", "Communication step [s]"),
    ("steps", "Communication steps"),
    ("record_every", "Recorded every (steps)"),
    ("wall_time", "Wall time [s]"),
    ("real_time_factor", "Real-time factor"),
    ("started", "Started"),
    ("python", "Python"),
    ("platform", "Platform"),
    ("command", "Command"),
)
FORMULAS = (
    "Cross-track error: horizontal distance of the true position to the nearest point of the "
    "polyline through the waypoints, positive to starboard. RMS and max are over all samples "
    "after the approach, which ends when the distance is first at most 1 m.",
    "Navigation error: estimate minus truth at the same communication point, so delays count; "
    "horizontal RMS = √mean(e_N² + e_E²). Inside 3 σ: share of samples with |e| ≤ 3 σ, mean of "
    "the axes; a consistent Gaussian filter has 99.7 %.",
    "Energy: the battery's integral ∫ V I dt; without that output, the trapezoidal rule on "
    "voltage and total current.",
    "Plots show the smallest and the largest sample of each of at most 700 intervals of time, so "
    "that no peak is lost; all samples are in signals.parquet.",
)


def provenance_html(provenance: Mapping[str, Any], *notes: str) -> str:
    """Return the sections below the plots; unknown facts are left out.

    `notes` describe the data in the page itself.
    """
    rows = facts_of(provenance)
    parts = ["<h2>Settings and sources of this run</h2>"]
    if rows:
        cells = "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in rows)
        parts.append(f'<div class="card"><table>{cells}</table></div>')
    for key, title in (("notes", "Notes: assumptions of this run"), ("warnings", "Warnings")):
        if provenance.get(key):
            parts.append(details_html(title, provenance[key], opened=True))
    if provenance.get("components"):
        components = provenance["components"]
        head = "<tr><th>Component</th><th>Kind</th><th>Source</th><th>Step [s]</th></tr>"
        cells = "".join(
            f"<tr><td>{escape(c.get('path', ''))}</td><td>{escape(c.get('kind', ''))}</td>"
            f"<td>{escape(c.get('source', ''))}</td>"
            f"<td>{escape(_shown(c.get('step', '')))}</td></tr>"
            for c in components
        )
        parts.append(
            f'<details class="card"><summary>{len(components)} components</summary>'
            f"<table>{head}{cells}</table></details>"
        )
    parts.append(details_html("How the figures are computed", (*FORMULAS, *notes)))
    version = escape(provenance.get("version", ""))
    parts.append(f"<footer>Written by uuvsim-cosim {version}. This file needs no network.</footer>")
    return "".join(parts)


def facts_of(provenance: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the known settings of a run with their labels, and what was changed."""
    changes = provenance.get("changes") or {}
    return [
        (label, _shown(provenance[key]))
        for key, label in SHOWN
        if provenance.get(key) not in (None, "")
    ] + [(f"Changed: {name}", _shown(value)) for name, value in changes.items() if value]


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{k} = {_shown(v)}" for k, v in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_shown(v) for v in value)
    return str(value)


def details_html(title: str, items: Sequence[str], *, opened: bool = False) -> str:
    """Return a list below a title, which opens it."""
    inside = "".join(f"<li>{escape(item)}</li>" for item in items)
    state = " open" if opened else ""
    head = f'<details class="card"{state}><summary>{escape(title)}</summary>'
    return f"{head}<ul>{inside}</ul></details>"
