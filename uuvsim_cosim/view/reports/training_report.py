"""The one-file reports of a training and of a curriculum, from their folders.

They have curves, figures of merit, episodes and the configuration.
"""

from __future__ import annotations

import base64
import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.plots import page
from uuvsim_cosim.view.plots.study_plots import STYLES, Course, card, grid_lines
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.recorded.traces import Array

__all__ = ["write_curriculum_report", "write_training_report"]

POINTS = 60  # of a curve of episodes
HIDDEN = ("step", "episodes", "stopped", "return")
STYLE = (
    ".area{stroke:none;opacity:.18}"
    + "".join(f".area.{s}{{fill:var(--{s})}}" for s in STYLES)
    + ".note{color:var(--muted);font-size:13px}"
    ".episodes img{width:100%;display:block}"
)
CURVES_NOTE = (
    '<p class="note">Episodes: means of those that ended together, or one after the other, and '
    "their quartiles. Evaluations: means of episodes without exploration, on seeds never "
    "trained on; metrics are over the second half of each episode.</p>"
)
Columns = Mapping[str, Array]
Pictures = Sequence[tuple[str, bytes]]  # PNG files by seed


def write_training_report(folder: str | Path) -> Path:
    """Write report.html into a training's folder; raises InputInvalid if it is none."""

    def page(place: Path, about: Any, judged: Any, pictures: Pictures) -> str:
        evaluations, episodes = (
            _columns_of(place / f"{n}.csv") for n in ("evaluations", "episodes")
        )
        c = about["config"]
        last = [
            columns["step"][-1]
            for columns in (evaluations, episodes)
            if len(columns.get("step", ()))
        ]
        steps = int(max(last, default=0))
        facts = f"seed {c['seed']} · {c['envs']} environments · {steps:,} of {c['steps']:,} steps"
        count = len(episodes.get("return", ()))
        scripted = (judged or {}).get("figures", {}).get("scripted", {})
        return _page_html(
            f"{c['task']}, {c['algorithm']}",
            f"{facts} · {count:,} episodes",
            [
                _judged_html(judged),
                "<h2>Curves</h2>",
                _curves_html(evaluations, episodes, {k: v["value"] for k, v in scripted.items()}),
                CURVES_NOTE,
                _episodes_html(pictures),
                _asked_html({**c, "version": about.get("version", "")}),
            ],
        )

    return _write_report(folder, "training", page)


def write_curriculum_report(folder: str | Path, stages: Sequence[Path]) -> Path:
    """Write report.html into a curriculum's folder; `stages` are those of the finished ones.

    Raises InputInvalid if it is none.
    """

    def page(_: Path, about: Any, judged: Any, pictures: Pictures) -> str:
        c = about["curriculum"]
        done = list(zip(stages, c["stages"], about["done"], strict=False))
        sections = []
        for k, (place, stage, row) in enumerate(done):
            evaluations, episodes = (
                _columns_of(place / f"{n}.csv") for n in ("evaluations", "episodes")
            )
            scripted = {} if row["scripted"] is None else {"return": row["scripted"]}
            facts = [
                f"{int(evaluations['step'][-1]):,} of {stage['steps']:,} steps",
                f"{len(episodes.get('return', ())):,} episodes",
                f"{row['cpu']:,.0f} CPU s",
                "promoted" if row["promoted"] else "all steps",
            ]
            if row.get("note"):
                facts.append(row["note"])
            sections += [
                f"<h2>Stage {k + 1}, {escape(stage['task'])}</h2>",
                f"<p>{escape(' · '.join(facts))}</p>",
                _curves_html(evaluations, episodes, scripted),
            ]
        cpu = sum(row["cpu"] for _, _, row in done)
        asked = {k: v for k, v in c.items() if k != "stages"}
        asked |= {f"stage {k + 1}": stage for k, stage in enumerate(c["stages"])}
        return _page_html(
            f"{c['name']}, {c['algorithm']}",
            f"seed {about['seed']} · {c['envs']} environments · {len(done)} of {len(c['stages'])} "
            f"stages · {cpu:,.0f} CPU s",
            [
                _judged_html(judged, "The best policy of the last stage"), *sections, CURVES_NOTE,
                _episodes_html(pictures), _asked_html(asked),
            ],
        )  # fmt: skip

    return _write_report(folder, "curriculum", page)


def _write_report(
    folder: str | Path, what: str, made: Callable[[Path, Any, Any, Pictures], str]
) -> Path:
    """Write report.html into the folder of a `what`: "training", whose training.json is there.

    `made` makes it of the folder, of what that file and judged.json hold (None where nothing was
    judged), and of pictures. Raises InputInvalid if the folder is none of the kind.
    """
    folder = Path(folder)
    try:
        about = json.loads((folder / f"{what}.json").read_text(encoding="utf-8"))
        judged = folder / "judged.json"
        figures = json.loads(judged.read_text(encoding="utf-8")) if judged.is_file() else None
        pictures = [(p.stem, p.read_bytes()) for p in sorted(folder.glob("pictures/*.png"))]
        text = made(folder, about, figures, pictures)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputInvalid(folder, f"is no {what} ({error})", "one") from None
    path = folder / "report.html"
    write_whole(path, text.encode())
    return path


def _page_html(title: str, subtitle: str, body: Sequence[str]) -> str:
    """Return a complete page that opens offline."""
    head = f"<header><h1>{escape(title)}</h1><p>{escape(subtitle)}</p></header>"
    return page.page_html(title, "uuvsim train", [head, *body], style=STYLE)


def _columns_of(path: Path) -> dict[str, Array]:
    """Read a curve, a column a name; nothing, where there is no file."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {k: np.array([float(row[k] or "nan") for row in rows]) for k in (rows or [{}])[0]}


def _curves_html(evaluations: Columns, episodes: Columns, scripted: Mapping[str, float]) -> str:
    """Return a plot of each figure over environment steps; `scripted` are figures, if known."""
    names = [k for k in ("return", *evaluations) if k in evaluations and k not in HIDDEN[:3]]
    cards, still = [], []
    for name in dict.fromkeys(names):
        every = np.concatenate([evaluations[name], episodes.get(name, np.zeros(0))])
        if len(every) > 1 and np.all(every == every[0]):
            still.append(f"{name} {every[0]:g}")
            continue
        courses = [Course("", *(np.zeros(0),) * 4)]
        keys = [("truth", "episodes, with exploration"), ("estimate", "evaluations")]
        if len(episodes.get(name, ())):
            # Episodes that ended together, or are neighbours: their mean and quartiles.
            ends, place = np.unique(episodes["step"], return_inverse=True)
            groups = [
                np.flatnonzero(np.isin(place, part))
                for part in np.array_split(np.arange(len(ends)), min(POINTS, len(ends)))
            ]
            values = [episodes[name][g] for g in groups]
            low, high = np.array([np.quantile(v, [0.25, 0.75]) for v in values]).T
            x = np.array([episodes["step"][g].mean() for g in groups])
            courses = [Course("episodes", x, np.array([v.mean() for v in values]), low, high)]
        courses.append(_plain("evaluations", evaluations["step"], evaluations[name]))
        if name in scripted and len(evaluations["step"]) > 1:
            ends = evaluations["step"][[0, -1]]
            courses.append(_plain("scripted", ends, np.full(2, float(scripted[name]))))
            keys.append(("third", "scripted"))
        cards.append(card(name, "", grid_lines(courses, "environment steps"), keys))
    rest = (
        f'<p class="note">Constant during the training: {escape(", ".join(still))}.</p>'
        if still
        else ""
    )
    return f'<div class="grid3">{"".join(cards)}</div>{rest}'


def _judged_html(judged: Mapping[str, Any] | None, what: str = "The best policy") -> str:
    """Return a table of how good the best policy is; nothing, where it was not judged."""
    if judged is None:
        return ""
    who = list(judged["figures"])
    head = "".join(f"<th>{escape(w)}</th>" for w in who)
    rows = "".join(
        f"<tr><td>{escape(name)}</td>"
        + "".join(
            f'<td class="number">{i["value"]:.4g} [{i["low"]:.4g}, {i["high"]:.4g}]</td>'.replace(
                "-", "−"
            )
            for i in (judged["figures"][w][name] for w in who)
        )
        + "</tr>"
        for name in judged["figures"][who[0]]
    )
    return (
        f"<h2>{escape(what)}, evaluated</h2>"
        f'<div class="card wide"><table><thead><tr><th>figure</th>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
        f'<p class="note">Means of {judged["episodes"]} episodes from seed {judged["seed"]}, which '
        "were not used for selection, with 95 % bootstrap intervals.</p>"
    )


def _episodes_html(pictures: Pictures) -> str:
    """Return pictures of episodes."""
    if not pictures:
        return ""
    cards = "".join(
        f'<div class="card"><h3>seed {escape(seed)}</h3><img alt="Episode of seed {escape(seed)}" '
        f'src="data:image/png;base64,{base64.b64encode(data).decode()}"></div>'
        for seed, data in pictures
    )
    title = "Episodes of the best policy, at their end"
    return f'<h2>{title}</h2><div class="grid2 episodes">{cards}</div>'


def _asked_html(asked: Mapping[str, object]) -> str:
    """Return the settings of the training as a table."""
    rows = "".join(
        f"<tr><th>{escape(k)}</th><td>{escape(_text(v))}</td></tr>" for k, v in asked.items()
    )
    return (
        '<details class="card" open><summary>Settings</summary>'
        f"<table><tbody>{rows}</tbody></table></details>"
    )


def _plain(label: str, x: Array, y: Array) -> Course:
    return Course(label, x, y, y, y)


def _text(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{k} = {_text(v)}" for k, v in value.items()) or "as it is"
    return "as it is" if value is None else str(value)
