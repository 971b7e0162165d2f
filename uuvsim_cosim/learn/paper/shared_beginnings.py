"""Ways that begin with the same stages: the stages trained by one are copied for the other.

The same stages with the same seed have the same bits. Two trackers and one, for example, share
their first scenarios, and a training with more steps begins as a shorter one does.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import load_checkpoint
from uuvsim_cosim.learn.paper.ways import (
    Budget,
    Chain,
    chains_of,
    first_of,
    place_of,
    plan_of,
)
from uuvsim_cosim.learn.training.curriculum import Curriculum
from uuvsim_cosim.learn.training.curriculum_folder import ABOUT, stage_folder

__all__ = ["begun"]


def begun(work: Path, budget: Budget, chain: Chain, seed: int) -> Path:
    """Return the folder of a chain's checkpoints.

    A new folder begins with the stages that another chain of this budget and seed has finished
    under `work`, as many as possible. Raises InputInvalid if they cannot be copied or resumed.
    """
    place, plan = place_of(work, budget, chain, seed), plan_of(chain, budget)
    if place.exists() or not isinstance(plan, Curriculum):
        return place
    about = {"curriculum": plan.plain(), "seed": first_of(seed)}
    others = [place_of(work, budget, c, seed) for c in chains_of("all")]
    found = [(other, *_alike(plan, about, other)) for other in others]
    source, count, done = max(found, key=lambda x: x[1])
    if count:
        names = [stage_folder(place, k, s.task).name for k, s in enumerate(plan.stages[:count])]
        _copy(source, place, names, {**about, "done": done})
    return place


# ---- inside -------------------------------------------------------------------------------


def _alike(
    plan: Curriculum, about: Mapping[str, Any], other: Path
) -> tuple[int, list[dict[str, object]]]:
    """Return how many first stages of another chain can be used, and the records of those finished.

    The last stage may be one that this chain trains for more steps.
    """
    try:
        read = json.loads((other / ABOUT).read_text(encoding="utf-8"))
        done = list(read["done"])
        both = (about["curriculum"], read["curriculum"])
        stages = zip(*(c["stages"] for c in both), range(len(done)), strict=False)
        mine, its = ({k: c[k] for k in c if k not in ("name", "stages")} for c in both)
        if mine != its or read["seed"] != about["seed"]:
            return 0, []
    except (OSError, ValueError, KeyError, TypeError):
        return 0, []
    count = 0
    for mine, its, k in stages:
        if mine != its:
            return k + _goes_on(mine, its, plan.evaluate_every), done[:k]
        count = k + 1
    return count, done[:count]


def _goes_on(mine: Mapping[str, Any], its: Mapping[str, Any], every: int) -> bool:
    """Return whether the other stage is the beginning of this one, with the same evaluations."""
    return (
        {**its, "steps": mine["steps"]} == mine
        and its["steps"] < mine["steps"]
        and its["steps"] % (its["evaluate_every"] or every) == 0
    )


def _copy(source: Path, place: Path, names: list[str], content: Mapping[str, object]) -> None:
    """Make the folder, whole or not at all."""
    new = place.with_name(f"{place.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    try:
        for name in names:
            shutil.copytree(source / name, new / name)
        load_checkpoint(source / names[-1] / "checkpoint.pt")  # refused by its own name
        write_whole(new / ABOUT, (json.dumps(content, indent=1) + "\n").encode())
        os.rename(new, place)
    except OSError as error:
        raise InputInvalid(
            place,
            f"what {source.name} begins with, too, cannot be copied there ({error})",
            "it to be readable, and room for it",
        ) from None
    finally:
        shutil.rmtree(new, ignore_errors=True)
