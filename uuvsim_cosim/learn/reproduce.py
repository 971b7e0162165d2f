"""The UUVSim paper's figures again: which trainings they need, each run or gone on with.

A run is a scenario learned in one way with one seed. What it leaves for good are a few small files
(`reproduce_results`); its checkpoints stay in a work folder.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.curriculum import Curriculum, Stage, StageTrained, train_curriculum
from uuvsim_cosim.learn.curriculum_stage import STAGE, spent
from uuvsim_cosim.learn.reproduce_results import Key, is_kept, keep

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training import TrainingObserver

__all__ = [
    "BUDGETS",
    "FIGURES",
    "Budget",
    "Chain",
    "chains_of",
    "keys_of",
    "lacking",
    "place_of",
    "reproduce",
    "reproduce_one",
]

Figure = Literal["fig7", "fig8", "fig9", "fig11"]
FIGURES: tuple[Figure, ...] = get_args(Figure)
SCENARIOS = ("source", "transition_1", "transition_2", "target")
SEEDS_APART = 1000  # seed k begins at environments' seed 1000 k: none is in two of them


@dataclass(frozen=True)
class Budget:
    """How much may be learned: `steps` of environments for each scenario, `envs` side by side."""

    name: str
    described: str
    envs: int
    steps: Mapping[str, int]
    evaluate_every: Mapping[str, int]  # environment steps
    settings: Mapping[str, Any] = field(default_factory=dict)  # of MASAC and SAC
    options: Mapping[str, Any] = field(default_factory=dict)  # of the tasks
    alone: Mapping[str, Any] = field(default_factory=dict)  # settings where there is one tracker
    of: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # settings, by scenario

    def episodes(self, scenario: str) -> int:
        """Give the episodes of 50 actions that its steps are."""
        return self.steps[scenario] // 50


BUDGETS = {
    b.name: b
    for b in (
        # About five CPU minutes for the longest; see docs/paper.md for what was tried.
        Budget(
            "batched",
            "64 environments side by side, about five CPU minutes for the longest scenario; the "
            "paper's numbers, parameters shared by the trackers, each with its own reward "
            "(`credit: own`). MASAC and ISAC: critics with layer normalisation after the first "
            "scenario, transitions drawn in mirror images as well, the average of the last actors "
            "leaves.",
            64,
            {"source": 32_000, "transition_1": 25_600, "transition_2": 83_200, "target": 256_000},
            {"source": 1_600, "transition_1": 3_200, "transition_2": 6_400, "target": 12_800},
            {"shared": True, "batch": 128, "normalised": True, "mirror": True, "average": 0.005},
            {"rules": {"credit": "own"}}, {"batch": 256},
            {"source": {"normalised": False, "updates": 10.0}},
        ),
        # 200 episodes, one environment, one update a step: as the paper, and its numbers.
        Budget(
            "paper",
            "200 episodes of one environment a scenario, one update a step, the paper's numbers, "
            "a network for each agent.",
            1, dict.fromkeys(SCENARIOS, 10_000), dict.fromkeys(SCENARIOS, 500),
        ),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Chain:
    """Scenarios learned one after the other, in one way: "stt-masac", "scratch-ippo"."""

    schooling: Literal["stt", "scratch"]
    algorithm: str
    scenarios: tuple[str, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    label: str = ""  # says what the options are

    @property
    def way(self) -> str:
        """Give the name of the way."""
        return "-".join(x for x in (self.schooling, self.algorithm, self.label) if x)


STT = Chain("stt", "masac", SCENARIOS)
FROM_SCRATCH = tuple(Chain("scratch", "masac", (s,)) for s in reversed(SCENARIOS[1:]))
OTHERS = tuple(
    Chain("scratch", algorithm, ("target",), label="all_steps")
    for algorithm in ("masac", "ippo", "idqn", "isac", "mappo")
)
TEAMS = (
    Chain("stt", "masac", ("source", "transition_1", "target"), {"n_trackers": 1}, "one"),
    Chain("stt", "masac", SCENARIOS, {"slots": [2, 2]}, "three"),
)
NEEDS: dict[Figure, tuple[Chain, ...]] = {
    "fig7": (STT, *FROM_SCRATCH),
    "fig8": (STT, *TEAMS),
    "fig9": (STT, *OTHERS),
    "fig11": (),  # of other form: `transfer_runs`
}


def chains_of(figure: str) -> tuple[Chain, ...]:
    """Give what a figure needs, or all of them do; raises InputInvalid with those there are."""
    names = [*FIGURES, "all"]
    if figure not in names:
        raise InputInvalid(f"figure {figure!r}: no such figure; expected one of {', '.join(names)}")
    chosen = FIGURES if figure == "all" else (figure,)
    return tuple({c.way + c.scenarios[-1]: c for f in chosen for c in NEEDS[f]}.values())  # type: ignore[index]


def keys_of(chain: Chain, budget: Budget, seed: int) -> list[Key]:
    """Give the names of what a chain leaves."""
    return [Key(budget.name, s, chain.way, seed) for s in chain.scenarios]


def place_of(work: Path, budget: Budget, chain: Chain, seed: int) -> Path:
    """Name the folder that a chain's checkpoints are in."""
    return work / budget.name / f"{chain.way}-{chain.scenarios[-1]}-{seed}"


def lacking(results: Path, figure: str, budget: Budget, seeds: int) -> list[tuple[Chain, int]]:
    """Give the chains and seeds of which results are not all there, way by way."""
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
    """Run what a figure lacks, way by way and seed by seed; gives what was run.

    Goes on where it stopped. Each finished scenario is kept under `results` at once; checkpoints
    are under `work`.
    """
    ran: list[Key] = []
    for chain, seed in lacking(results, figure, budget, seeds):
        ran += reproduce_one(
            chain, budget, seed, results, place_of(work, budget, chain, seed),
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
    """Run a chain with one seed, or go on with it in `place`; gives what was run."""
    wanted, ran = keys_of(chain, budget, seed), []

    def told(k: int, stage: Stage) -> None:
        if begins is not None:
            begins(f"{stage.task}, {chain.way}, seed {seed}")

    def kept(k: int, folder: Path, about: Mapping[str, Any]) -> None:
        if not is_kept(results, wanted[k]):
            keep(results, wanted[k], folder, about, episodes=episodes)
            ran.append(wanted[k])

    _train(chain, budget, seed, place, observers, interrupted, told, kept)
    return ran


def curriculum_for(chain: Chain, budget: Budget) -> Curriculum:
    """Give a chain as a curriculum; without schooling it has one stage."""
    steps = {s: budget.steps[s] for s in chain.scenarios}
    if chain.label == "all_steps":  # as many as the whole schooling has
        steps = {chain.scenarios[-1]: sum(budget.steps.values())}
    stages = tuple(_stage(chain, budget, s, steps[s]) for s in chain.scenarios)
    return Curriculum(
        chain.way, stages, algorithm=chain.algorithm, settings=budget.settings,
        options={**budget.options}, envs=budget.envs,
    )  # fmt: skip


# ---- inside -------------------------------------------------------------------------------


def _stage(chain: Chain, budget: Budget, scenario: str, steps: int) -> Stage:
    options = dict(chain.options)
    several = scenario in ("transition_2", "target")
    if chain.label == "three" and several:
        options["n_trackers"] = 3
    alone = not several or options.get("n_trackers") == 1
    settings = {**(budget.alone if alone else {}), **budget.of.get(scenario, {})}
    return Stage(scenario, steps, options, settings, evaluate_every=budget.evaluate_every[scenario])


def _train(
    chain: Chain, budget: Budget, seed: int, place: Path,
    observers: tuple[TrainingObserver, ...], interrupted: Callable[[], bool] | None,
    told: Callable[[int, Stage], None], kept: Callable[[int, Path, Mapping[str, Any]], None],
) -> None:  # fmt: skip
    """Train a chain; `kept` is given the folder of each scenario as it ends, and what it is."""
    first = SEEDS_APART * seed
    about = {"algorithm": chain.algorithm, "schooling": chain.schooling, "envs": budget.envs,
             "first seed": first}  # fmt: skip
    made = curriculum_for_any(chain, budget)
    if not isinstance(made, Curriculum):
        from uuvsim_cosim.learn.train import train

        (scenario,) = chain.scenarios
        told(0, Stage(scenario, made["steps"]))
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
        stage = made.stages[k]
        kept(k, done.folder, {
            **about, "cpu": done.cpu, "steps": stage.steps, "task": stage.task,
            "settings": {**made.settings, **stage.settings},
            "options": {**made.options, **stage.options},
        })  # fmt: skip

    every = train_curriculum(
        made, place, seed=first, observers=observers, interrupted=interrupted, stage_begins=told,
        stage_ends=ended, first=first,
    )  # fmt: skip
    for k, stage_done in enumerate(every):  # those that an earlier call trained, and did not keep
        ended(k, stage_done)


def curriculum_for_any(chain: Chain, budget: Budget) -> Curriculum | dict[str, Any]:
    """Give a chain as a curriculum, or as one training's fields where nothing can be passed on."""
    if chain.algorithm in ("masac", "isac"):
        return curriculum_for(chain, budget)
    (scenario,) = chain.scenarios
    return {
        "algorithm": chain.algorithm, "envs": budget.envs, "steps": sum(budget.steps.values()),
        "evaluate_every": budget.evaluate_every[scenario],
        "task_options": {**budget.options, **chain.options},
    }  # fmt: skip
