"""Reproduction of the UUVSim paper's figures: the trainings that they need, run or resumed.

A run is a scenario learned in one way with one seed. Its results are a few small files
(`results.py`); its checkpoints stay in a work folder.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import load_checkpoint
from uuvsim_cosim.learn.paper.results import Key, is_kept, keep
from uuvsim_cosim.learn.paper.ways import (
    Budget,
    Chain,
    chains_of,
    first_of,
    options_of,
    place_of,
    plan_of,
    scenarios_of,
)
from uuvsim_cosim.learn.training.curriculum import Curriculum, Stage
from uuvsim_cosim.learn.training.folders import CURRICULUM, STAGE, stage_folder
from uuvsim_cosim.learn.training.train_curriculum import StageTrained, spent, train_curriculum

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.training import TrainingObserver

__all__ = ["Hooks", "begun", "keys_of", "lacking", "reproduce", "reproduce_one"]


def keys_of(chain: Chain, budget: Budget, seed: int) -> list[Key]:
    """Return the names of the results of a chain."""
    return [Key(budget.name, s, chain.way, seed) for s in scenarios_of(chain, budget)]


def lacking(results: Path, figure: str, budget: Budget, seeds: int) -> list[tuple[Chain, int]]:
    """Return the chains and seeds with missing results, way by way."""
    return [
        (chain, seed)
        for chain in chains_of(figure)
        for seed in range(seeds)
        if not all(is_kept(results, key) for key in keys_of(chain, budget, seed))
    ]


class Hooks(TypedDict, total=False):
    """Options of a run that do not change its bits, and the number of episodes to judge by."""

    observers: tuple[TrainingObserver, ...]
    interrupted: Callable[[], bool] | None
    begins: Callable[[str], None] | None  # is called with the name of each training
    episodes: int


def reproduce(
    figure: str, budget: Budget, seeds: int, results: Path, work: Path, **hooks: Unpack[Hooks]
) -> list[Key]:
    """Run the missing results of a figure, way by way and seed by seed; returns their names.

    An interrupted run is resumed. Ways that begin with the same stages share them. The results of
    a finished scenario are written under `results` at once; checkpoints are under `work`.
    """
    ran: list[Key] = []
    for chain, seed in lacking(results, figure, budget, seeds):
        place = begun(work, budget, chain, seed)
        ran += reproduce_one(chain, budget, seed, results, place, **hooks)
    return ran


def reproduce_one(
    chain: Chain,
    budget: Budget,
    seed: int,
    results: Path,
    place: Path,
    *,
    observers: tuple[TrainingObserver, ...] = (),
    interrupted: Callable[[], bool] | None = None,
    begins: Callable[[str], None] | None = None,
    episodes: int = 100,
) -> list[Key]:
    """Run a chain with one seed, or resume it in `place`; returns the names of new results."""
    keys, ran, first = keys_of(chain, budget, seed), [], first_of(seed)

    def report(_: int, stage: Stage) -> None:
        if begins is not None:
            begins(f"{stage.task}, {chain.way}, seed {seed}")

    def finish(k: int, folder: Path, **about: object) -> None:
        if not is_kept(results, keys[k]):
            about |= {"algorithm": chain.algorithm, "schooling": chain.schooling,
                      "envs": budget.envs, "first seed": first}  # fmt: skip
            keep(results, keys[k], folder, about, episodes=episodes)
            ran.append(keys[k])

    made = plan_of(chain, budget)
    if not isinstance(made, Curriculum):
        from uuvsim_cosim.learn.training.train import train

        (scenario,) = chain.scenarios
        report(0, Stage(scenario, made["steps"]))
        before, began = spent(place / STAGE), time.process_time()
        try:
            train(
                scenario, folder=place, observers=observers, tensorboard=False, seed=first,
                first=first, interrupted=interrupted, **made,
            )  # fmt: skip
        finally:
            cpu = before + time.process_time() - began
            if place.is_dir():
                write_whole(place / STAGE, json.dumps({"cpu": cpu}).encode())
        finish(0, place, cpu=cpu, steps=made["steps"], settings={}, task=scenario,
               options=made["task_options"])  # fmt: skip
        return ran

    def ended(k: int, done: StageTrained) -> None:
        stage, scenario = made.stages[k], keys[k].scenario
        under = budget.under.get(scenario)
        finish(
            k, done.folder, cpu=done.cpu, steps=stage.steps, task=stage.task,
            settings={**made.settings, **stage.settings},
            options={**made.options, **options_of(chain, scenario)},
            **({"learned under": under} if under else {}),
        )  # fmt: skip

    every = train_curriculum(
        made, place, seed=first, observers=observers, interrupted=interrupted, stage_begins=report,
        stage_ends=ended, first=first, tensorboard=False,
    )  # fmt: skip
    for k, done in enumerate(every):  # an earlier call may have stopped before `finish`
        ended(k, done)
    return ran


# ---- stages that several ways begin with --------------------------------------------------


def begun(work: Path, budget: Budget, chain: Chain, seed: int) -> Path:
    """Return the folder of a chain's checkpoints.

    A new folder begins with the stages that another chain of this budget and seed has finished
    under `work`, as many as possible: the same stages with the same seed have the same bits. Two
    trackers and one, for example, share their first scenarios, and a training with more steps
    begins as a shorter one does. Raises InputInvalid if they cannot be copied or resumed.
    """
    place, plan = place_of(work, budget, chain, seed), plan_of(chain, budget)
    if place.exists() or not isinstance(plan, Curriculum):
        return place
    about = {"curriculum": plan.plain(), "seed": first_of(seed)}
    others = [place_of(work, budget, c, seed) for c in chains_of("all")]
    found = [(other, *_alike(plan, about, other)) for other in others]
    source, count, done = max(found, key=lambda x: x[1])
    if not count:
        return place
    names = [stage_folder(place, k, s.task).name for k, s in enumerate(plan.stages[:count])]
    new = place.with_name(f"{place.name}.new")  # renamed when it is whole
    shutil.rmtree(new, ignore_errors=True)
    try:
        for name in names:
            shutil.copytree(source / name, new / name)
        load_checkpoint(source / names[-1] / "checkpoint.pt")  # refused by its own name
        content = json.dumps({**about, "done": done}, indent=1) + "\n"
        write_whole(new / CURRICULUM, content.encode())
        os.rename(new, place)
    except OSError as error:
        raise InputInvalid(
            place,
            f"the start that it shares with {source.name} cannot be copied there ({error})",
            "it to be readable, and room for it",
        ) from None
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return place


def _alike(
    plan: Curriculum, about: Mapping[str, Any], other: Path
) -> tuple[int, list[dict[str, object]]]:
    """Return how many first stages of another chain can be used, and the records of finished ones.

    The last stage may be one that this chain trains for more steps, with the same evaluations.
    """
    try:
        read = json.loads((other / CURRICULUM).read_text(encoding="utf-8"))
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
            is_beginning = (
                {**its, "steps": mine["steps"]} == mine
                and its["steps"] < mine["steps"]
                and its["steps"] % (its["evaluate_every"] or plan.evaluate_every) == 0
            )
            return k + is_beginning, done[:k]
        count = k + 1
    return count, done[:count]
