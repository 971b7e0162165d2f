"""The one-file report of a study, from its folder: intervals, plots and settings."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypedDict

import numpy as np

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.plots.page import page_html
from uuvsim_cosim.view.plots.study_plots import STYLES, Course, card, grid_lines, histogram, scatter
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.recorded.traces import Array

__all__ = ["study_html", "write_study_report"]

MOST_SCATTERS = 4
MOST_ROWS = 60
STYLE = (
    ".bar{fill:var(--truth)}.dots{fill:none;stroke:var(--truth);stroke-width:5;"
    "stroke-linecap:round;opacity:.45}.area{stroke:none;opacity:.18}"
    + "".join(f".area.{s}{{fill:var(--{s})}}" for s in STYLES)
    + "h2 code{font-weight:400;color:var(--muted);font-size:13px;"
    "margin-left:10px}.note{color:var(--muted);font-size:13px}"
)


class Parameter(TypedDict):
    """A parameter of a study: an axis of the grid ("grid"), or drawn at random ("drawn")."""

    name: str
    kind: str
    unit: str


class Metric(TypedDict):
    """A metric of a study, and the expression that defines it."""

    name: str
    unit: str
    expression: str


class Interval(TypedDict):
    """Mean of a metric over the runs of one grid point; None stands for NaN."""

    metric: str
    point: int
    at: Mapping[str, float]  # value of each axis of the grid
    n: int
    mean: float | None
    low: float | None
    high: float | None
    std: float | None


StudyFile = TypedDict(
    "StudyFile",
    {
        "name": str,
        "system": str,
        "duration": float,  # s
        "runs": int,
        "failed": int,
        "remarks": Sequence[str],
        "asked": Mapping[str, object],
        "parameters": Sequence[Parameter],
        "metrics": Sequence[Metric],
        "intervals": Sequence[Interval],
        # By metric and parameter; None if a parameter or the metric is constant.
        "rank correlation": Mapping[str, Mapping[str, float | None]],
    },
)
"""What the report needs of study.json (`studies/result.py` writes it)."""


def write_study_report(folder: str | Path) -> Path:
    """Write report.html into a study's folder; raises InputInvalid if it is none."""
    import pyarrow.parquet as pq

    folder = Path(folder)
    try:
        about = json.loads((folder / "study.json").read_text(encoding="utf-8"))
        table = pq.read_table(folder / "runs.parquet")
        columns = {n: table[n].to_numpy() for n in table.column_names if n != "failure"}
        page = study_html(about, columns, table["failure"].to_pylist())
    except (OSError, ValueError, KeyError) as error:
        raise InputInvalid(folder, f"is no finished study ({error})", "one") from None
    path = folder / "report.html"
    write_whole(path, page.encode())
    return path


def study_html(
    about: StudyFile, columns: Mapping[str, Array], failures: Sequence[str | None]
) -> str:
    """Return the report as one HTML page."""
    grid = [p for p in about["parameters"] if p["kind"] == "grid" and _varies(columns, p)]
    points = len({i["point"] for i in about["intervals"]})
    runs = f"{about['runs']} runs"
    if points > 1:
        runs += f": {points} grid points, {about['runs'] // points} seeds"
    facts = [f"{about['system']}, {about['duration']:g} s", runs]
    if about["failed"]:
        facts.append(f"{about['failed']} failed")
    body = [
        f"<header><h1>{escape(about['name'])}</h1><p>{escape(' · '.join(facts))}</p></header>",
        *(f"<p>{escape(remark)}</p>" for remark in about["remarks"]),
    ]
    body += [_section(metric, about, grid, columns) for metric in about["metrics"]]
    rows = ""
    for k, v in about["asked"].items():
        if isinstance(v, list):
            more = f"; and {len(v) - 40} more" if len(v) > 40 else ""
            v = "; ".join(str(item) for item in v[:40]) + more
        rows += f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>"
    body.append(_table(about, grid))
    failed = [(i, f) for i, f in enumerate(failures) if f is not None]
    if failed:
        lines = "".join(
            f'<tr><td class="number">{i}</td><td class="number">{int(columns["seed"][i])}</td>'
            f"<td>{escape(why)}</td></tr>"
            for i, why in failed[:20]
        )
        more = f"<p>and {len(failed) - 20} more, in runs.parquet</p>" if len(failed) > 20 else ""
        body.append(
            f'<h2>{len(failed)} runs failed</h2><div class="card"><table><thead><tr><th>run</th>'
            f"<th>seed</th><th>failure</th></tr></thead><tbody>{lines}</tbody></table>{more}</div>"
        )
    body.append(
        '<details class="card"><summary>Settings</summary>'
        f"<table><tbody>{rows}</tbody></table></details>"
    )
    return page_html(about["name"], "uuvsim study", body, style=STYLE)


def _varies(columns: Mapping[str, Array], parameter: Parameter) -> bool:
    return len(np.unique(columns[parameter["name"]])) > 1


def _section(
    metric: Metric, about: StudyFile, grid: Sequence[Parameter],
    columns: Mapping[str, Array],
) -> str:  # fmt: skip
    name, unit = metric["name"], metric["unit"]
    values = columns[name]
    cards = []
    if grid:
        cards.append(_along(name, unit, about, grid))
    cards.append(card("number of runs by value", unit, histogram(values),
                      [("estimate dash", "median")]))  # fmt: skip
    # The runs of the grid point where the metric varies most, and its parameters.
    here, where = np.ones(len(columns["point"]), bool), ""
    spread = [
        (i["std"], i) for i in about["intervals"] if i["metric"] == name and i["std"] is not None
    ]
    if grid and spread:
        _, row = max(spread, key=lambda pair: pair[0])
        where = ", ".join(f"{p['name']} = {row['at'][p['name']]:g} {p['unit']}" for p in grid)
        here = columns["point"] == row["point"]
    ranks = about["rank correlation"][name]
    drawn = [p for p in about["parameters"] if p["kind"] == "drawn" and _varies(columns, p)]
    known = [(p, rank) for p in drawn if (rank := ranks[p["name"]]) is not None]
    best = sorted(known, key=lambda pair: -abs(pair[1]))[:MOST_SCATTERS]
    for p, rank in best:
        title = f"against {p['name']}, rank correlation {rank:+.2f}"
        picture = scatter(columns[p["name"]][here], values[here], _with_unit(p))
        cards.append(card(title.replace("-", "−"), "", picture))
    notes = []
    if best and where:
        notes.append(f"Dots show the runs at {where}, where they differ most; rank correlations "
        "are computed within grid points, over all points.")  # fmt: skip
    if len(known) > len(best):
        notes.append(f"{len(known) - len(best)} more parameters have less rank correlation.")
    rest = f'<p class="note">{escape(" ".join(notes))}</p>' if notes else ""
    return (
        f"<h2>{escape(name)} {escape(f'[{unit}]' if unit not in ('', '1') else '')}"
        f"<code>{escape(metric['expression'])}</code></h2>"
        f'<div class="grid3">{"".join(cards)}</div>{rest}'
    )


def _along(name: str, unit: str, about: StudyFile, grid: Sequence[Parameter]) -> str:
    """Draw means along the grid's longest axis, a course for each value of the next."""
    rows = [i for i in about["intervals"] if i["metric"] == name]
    count = {p["name"]: len({r["at"][p["name"]] for r in rows}) for p in grid}
    axes = sorted(grid, key=lambda p: -count[p["name"]])
    axis, others = axes[0], axes[1:]
    if others and count[others[0]["name"]] > len(STYLES):
        others = []
    courses = []
    for value in sorted({r["at"][others[0]["name"]] for r in rows}) if others else [None]:
        mine = [r for r in rows if value is None or r["at"][others[0]["name"]] == value]
        x = sorted({r["at"][axis["name"]] for r in mine})
        stacks = [[r for r in mine if r["at"][axis["name"]] == at] for at in x]
        label = "" if value is None else f"{others[0]['name']} = {value:g} {others[0]['unit']}"
        courses.append(Course(
            label, np.array(x), _means([[r["mean"] for r in s] for s in stacks]),
            _means([[r["low"] for r in s] for s in stacks]),
            _means([[r["high"] for r in s] for s in stacks]),
        ))  # fmt: skip
    merged = len(axes) - 1 - len(others[:1])
    title = "mean with 95 % interval" + (f", over {merged} other axes" if merged else "")
    keys = [(s, c.label) for s, c in zip(STYLES, courses, strict=False) if c.label]
    return card(title, unit, grid_lines(courses, _with_unit(axis)), keys)


def _with_unit(p: Parameter) -> str:
    return p["name"] if p["unit"] in ("", "1") else f"{p['name']} [{p['unit']}]"


def _means(groups: Sequence[Sequence[float | None]]) -> Array:
    """Return the mean of each group without its None; NaN if nothing else is in it."""
    known = [[v for v in group if v is not None] for group in groups]
    return np.array([float(np.mean(values)) if values else float("nan") for values in known])


def _table(about: StudyFile, grid: Sequence[Parameter]) -> str:
    names = [m["name"] for m in about["metrics"]]
    points: dict[int, dict[str, Interval]] = {}  # by number of the point and by metric
    for row in about["intervals"]:
        points.setdefault(row["point"], {})[row["metric"]] = row
    head = "".join(f"<th>{escape(_with_unit(p))}</th>" for p in grid)
    head += "<th>runs</th>" + "".join(f"<th>{escape(n)}</th>" for n in names)
    rows = []
    for found in list(points.values())[:MOST_ROWS]:
        at = next(iter(found.values()))["at"]
        cells = [f'<td class="number">{at[p["name"]]:g}</td>' for p in grid]
        cells.append(f'<td class="number">{max(found[n]["n"] for n in names)}</td>')
        for n in names:
            r = found[n]
            mean = "–" if r["mean"] is None else f"{r['mean']:.4g}"
            band = "" if r["low"] is None else f" [{r['low']:.4g}, {r['high']:.4g}]"
            cells.append(f'<td class="number">{(mean + band).replace("-", "−")}</td>')
        rows.append(f"<tr>{''.join(cells)}</tr>")
    more = len(points) - len(rows)
    rest = f"<p>and {more} more, in study.json</p>" if more > 0 else ""
    return (
        "<h2>Means with 95 % bootstrap intervals</h2>"
        f'<div class="card wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>{rest}</div>"
    )
