"""The one-file report of a training, from its folder: curves, figures, episodes, configuration."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.view.training_parts import (
    CURVES_NOTE,
    Columns,
    asked_html,
    columns_of,
    curves_html,
    episodes_html,
    judged_html,
    page_html,
    pictures_of,
)

__all__ = ["training_html", "write_training_report"]


def write_training_report(folder: str | Path) -> Path:
    """Write report.html into a training's folder; raises InputInvalid if it is none."""
    folder = Path(folder)
    try:
        about = json.loads((folder / "training.json").read_text(encoding="utf-8"))
        judged = folder / "judged.json"
        figures = json.loads(judged.read_text(encoding="utf-8")) if judged.is_file() else None
        columns = [columns_of(folder / f"{n}.csv") for n in ("evaluations", "episodes")]
        page = training_html(about, columns[0], columns[1], figures, pictures_of(folder))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputInvalid(f"{folder}: is no training ({error}); expected one") from None
    path = folder / "report.html"
    write_whole(path, page.encode())
    return path


def training_html(
    about: Mapping[str, Any],
    evaluations: Columns,
    episodes: Columns,
    judged: Mapping[str, Any] | None,
    pictures: Sequence[tuple[str, bytes]],
) -> str:
    """Give the report as one HTML page; `pictures` are PNG files by seed."""
    c = about["config"]
    last = [
        columns["step"][-1] for columns in (evaluations, episodes) if len(columns.get("step", ()))
    ]
    steps = int(max(last, default=0))
    told = f"seed {c['seed']} · {c['envs']} environments · {steps:,} of {c['steps']:,} steps"
    count = len(episodes.get("return", ()))
    scripted = (judged or {}).get("figures", {}).get("scripted", {})
    return page_html(
        f"{c['task']}, {c['algorithm']}",
        f"{told} · {count:,} episodes",
        [
            judged_html(judged),
            "<h2>Curves</h2>",
            curves_html(evaluations, episodes, {k: v["value"] for k, v in scripted.items()}),
            CURVES_NOTE,
            episodes_html(pictures),
            asked_html({**c, "version": about.get("version", "")}),
        ],
    )
