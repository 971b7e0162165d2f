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
from typing import TYPE_CHECKING, Any

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

__all__ = ["begun", "keys_of", "lacking", "reproduce", "reproduce_one"]


def keys_of(chain: Chain, budget: Budget, seed: int) -> list[Key]:
    """Return the names of the results of a chain."""
    return [Key(budget.name, s, chain.way, seed) for s in scenarios_of(chain, budget)]


def lacking(results: Path, figure: str, budget: Budget, seeds: int) -> list[tuple[Chain, int]]:
    """Return the chains and seeds of which results are not all there, way by way."""
    return [
        (chain, seed)
        for chain in chains_of(figure)
        for seed in range(seeds)
        if not all(is_kept(results, key) for key in keys_of(chain, budget, seed))
    ]


def reproduce(
    figure: str,
    budget: Budget,
    seeds: int,
    results: Path,
    work: Path,
    *,
    observers: tuple[TrainingObserver, ...] = (),
    interrupted: Callable[[], bool] | None = None,
    begins: Callable[[str], None] | None = None,
    episodes: int = 100,
) -> list[Key]:
    """Run the missing results of a figure, way by way and seed by seed; returns their names.

    An interrupted run is resumed. Ways that begin with the same stages share them. The results of
    a finished scenario are written under `results` at once; checkpoints are under `work`.
    """
    ran: list[Key] = []
    for chain, seed in lacking(results, figure, budget, seeds):
        ran += reproduce_one(
            chain, budget, seed, results, begun(work, budget, chain, seed),
            observers=observers, interrupted=interrupted, begins=begins, episodes=episodes,
        )  # fmt: skip
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
    wanted, ran = keys_of(chain, budget, seed), []

    def report(k: int, stage: Stage) -> None:
        if begins is not None:
            begins(f"{stage.task}, {chain.way}, seed {seed}")

    def kept(k: int, folder: Path, about: Mapping[str, object]) -> None:
        if not is_kept(results, wanted[k]):
            keep(results, wanted[k], folder, about, episodes=episodes)
            ran.append(wanted[k])

    _train(chain, budget, seed, place, observers, interrupted, report, kept)
    return ran


# ---- inside -------------------------------------------------------------------------------


def _train(
    chain: Chain, budget: Budget, seed: int, place: Path,
    observers: tuple[TrainingObserver, ...], interrupted: Callable[[], bool] | None,
    begins: Callable[[int, Stage], None], kept: Callable[[int, Path, Mapping[str, object]], None],
) -> None:  # fmt: skip
    """Train a chain; `kept` is called with the folder and description of each finished scenario."""
    first = first_of(seed)
    about = {"algorithm": chain.algorithm, "schooling": chain.schooling, "envs": budget.envs,
             "first seed": first}  # fmt: skip
    made = plan_of(chain, budget)
    if not isinstance(made, Curriculum):
        from uuvsim_cosim.learn.training.train import train

        (scenario,) = chain.scenarios
        begins(0, Stage(scenario, made["steps"]))
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
        kept(0, place, {**about, "cpu": cpu, "steps": made["steps"], "settings": {},
                        "task": scenario, "options": made["task_options"]})  # fmt: skip
        return

    def ended(k: int, done: StageTrained) -> None:
        stage, scenario = made.stages[k], scenarios_of(chain, budget)[k]
        under = budget.under.get(scenario)
        kept(k, done.folder, {
            **about, "cpu": done.cpu, "steps": stage.steps, "task": stage.task,
            "settings": {**made.settings, **stage.settings},
            "options": {**made.options, **options_of(chain, scenario)},
            **({"learned under": under} if under else {}),
        })  # fmt: skip

    every = train_curriculum(
        made, place, seed=first, observers=observers, interrupted=interrupted, stage_begins=begins,
        stage_ends=ended, first=first, tensorboard=False,
    )  # fmt: skip
    for k, stage_done in enumerate(every):  # an earlier call may have stopped before `kept`
        ended(k, stage_done)


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
        write_whole(new / CURRICULUM, (json.dumps(content, indent=1) + "\n").encode())
        os.rename(new, place)
    except OSError as error:
        raise InputInvalid(
            place,
            f"what {source.name} begins with, too, cannot be copied there ({error})",
            "it to be readable, and room for it",
        ) from None
    finally:
        shutil.rmtree(new, ignore_errors=True)
