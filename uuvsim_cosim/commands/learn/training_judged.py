"""Evaluation of a finished training for its report: figures, and pictures of episodes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.cache import write_whole

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.statistics import Interval

__all__ = ["write_judged"]

PICTURES = 4  # episodes drawn
EPISODES = 100


def write_judged(folder: Path, episodes: int = EPISODES) -> None:
    """Evaluate the best policy of a training; write judged.json and pictures/ into its folder."""
    from uuvsim_cosim.commands.learn.policies import acting_of
    from uuvsim_cosim.learn.policies.playing import frames_of
    from uuvsim_cosim.learn.training.judging import judge, judge_scripted
    from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED
    from uuvsim_cosim.view.plots.png import png

    found = acting_of([str(folder)], None, {})
    (acts,) = found.policies.values()
    rows: dict[str, Mapping[str, Interval]] = {"best": judge(found.task, [acts], episodes)}
    if yardstick := judge_scripted(found.task, episodes):
        rows["scripted"] = yardstick
    (folder / "pictures").mkdir(exist_ok=True)
    for k in range(PICTURES):
        *_, last = frames_of(found.task, acts, JUDGING_SEED + k)
        write_whole(folder / "pictures" / f"{JUDGING_SEED + k}.png", png(last))
    content = {
        "episodes": episodes,
        "seed": JUDGING_SEED,
        "figures": {who: {k: asdict(i) for k, i in r.items()} for who, r in rows.items()},
    }
    write_whole(folder / "judged.json", (json.dumps(content, indent=1) + "\n").encode())
