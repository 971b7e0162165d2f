"""The one-file report of a curriculum, from its folder: the curves of each stage, one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.reports.training_parts import (
    CURVES_NOTE,
    Pictures,
    asked_html,
    columns_of,
    curves_html,
    episodes_html,
    judged_html,
    page_html,
    write_report,
)

__all__ = ["write_curriculum_report"]


def write_curriculum_report(folder: str | Path, stages: Sequence[Path]) -> Path:
    """Write report.html into a curriculum's folder; `stages` are those of the finished ones.

    Raises InputInvalid if it is none.
    """
    return write_report(folder, "curriculum", lambda _, about, *shown: _page(about, stages, *shown))


# ---- inside -------------------------------------------------------------------------------


def _page(
    about: Mapping[str, Any], stages: Sequence[Path], judged: Mapping[str, Any] | None,
    pictures: Pictures,
) -> str:  # fmt: skip
    c = about["curriculum"]
    done = list(zip(stages, c["stages"], about["done"], strict=False))
    sections = []
    for k, (place, stage, row) in enumerate(done):
        evaluations, episodes = (
            columns_of(place / f"{n}.csv") for n in ("evaluations", "episodes")
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
            curves_html(evaluations, episodes, scripted),
        ]
    cpu = sum(row["cpu"] for _, _, row in done)
    asked = {k: v for k, v in c.items() if k != "stages"}
    asked |= {f"stage {k + 1}": stage for k, stage in enumerate(c["stages"])}
    return page_html(
        f"{c['name']}, {c['algorithm']}",
        f"seed {about['seed']} · {c['envs']} environments · {len(done)} of {len(c['stages'])} "
        f"stages · {cpu:,.0f} CPU s",
        [
            judged_html(judged, "The best policy of the last stage"), *sections, CURVES_NOTE,
            episodes_html(pictures), asked_html(asked),
        ],
    )  # fmt: skip
