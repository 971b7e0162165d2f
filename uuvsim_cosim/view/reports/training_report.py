"""The one-file report of a training, from its folder: curves, figures, episodes, configuration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uuvsim_cosim.view.reports.training_parts import (
    CURVES_NOTE,
    Columns,
    Pictures,
    asked_html,
    columns_of,
    curves_html,
    episodes_html,
    judged_html,
    page_html,
    write_report,
)

__all__ = ["training_html", "write_training_report"]


def write_training_report(folder: str | Path) -> Path:
    """Write report.html into a training's folder; raises InputInvalid if it is none."""

    def page(place: Path, about: Any, judged: Any, pictures: Pictures) -> str:
        evaluations, episodes = (
            columns_of(place / f"{n}.csv") for n in ("evaluations", "episodes")
        )
        return training_html(about, evaluations, episodes, judged, pictures)

    return write_report(folder, "training", page)


def training_html(
    about: Mapping[str, Any],
    evaluations: Columns,
    episodes: Columns,
    judged: Mapping[str, Any] | None,
    pictures: Pictures,
) -> str:
    """Return the report as one HTML page; `pictures` are PNG files by seed."""
    c = about["config"]
    last = [
        columns["step"][-1] for columns in (evaluations, episodes) if len(columns.get("step", ()))
    ]
    steps = int(max(last, default=0))
    facts = f"seed {c['seed']} · {c['envs']} environments · {steps:,} of {c['steps']:,} steps"
    count = len(episodes.get("return", ()))
    scripted = (judged or {}).get("figures", {}).get("scripted", {})
    return page_html(
        f"{c['task']}, {c['algorithm']}",
        f"{facts} · {count:,} episodes",
        [
            judged_html(judged),
            "<h2>Curves</h2>",
            curves_html(evaluations, episodes, {k: v["value"] for k, v in scripted.items()}),
            CURVES_NOTE,
            episodes_html(pictures),
            asked_html({**c, "version": about.get("version", "")}),
        ],
    )
