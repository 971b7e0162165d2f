"""Reproduction of figure 11: policies trained on the plain plant, tested with delays and weak jets.

Each way of learning is run with each seed, then judged under each condition, without and with
anticipation of the delays. The results of a way and a seed are one small JSON file.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.envs.task.task import TeamTask
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.envs.tasks.scripted import scripted_policy
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.paper.anticipation import Anticipating
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.loading import acting_in, load_policies
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED

if TYPE_CHECKING:
    from uuvsim_cosim.learn.paper.reproduce import Hooks
    from uuvsim_cosim.learn.training.training import TrainingObserver

__all__ = [
    "CONDITIONS",
    "WAYS",
    "Condition",
    "Judged",
    "Way",
    "lacking_transfers",
    "read_transfers",
    "run_transfer",
    "run_transfers",
]

EPISODES = 400  # of the scripted controller, that clones and transformers learn from
SEEDS_APART = 1000


@dataclass(frozen=True)
class Way:
    """Way to make a policy."""

    name: str
    words: str
    task: str = "transition_1"
    options: Mapping[str, object] = field(default_factory=dict)
    steps: int = 0  # of environments, for an algorithm that acts in the task
    algorithm: str = ""  # "sac", or one that learns offline


WAYS = {
    w.name: w
    for w in (
        Way("scripted", "the teacher, hand-written"),
        Way("bc", f"behaviour cloning of {EPISODES} scripted episodes", algorithm="bc"),
        Way("dt", f"decision transformer of the same {EPISODES}", algorithm="dt"),
        Way("sac", "SAC on the plain plant", steps=38_400, algorithm="sac"),
        Way("sac-randomised", "SAC with domain randomisation", "disturbed", {"randomise": True},
            51_200, "sac"),
    )
}  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """Condition of the test; `options` are those of the task."""

    words: str
    options: Mapping[str, float]
    task: str = "disturbed"

    @property
    def late(self) -> tuple[float, float]:
        """The delays of positions and of commands [s], which anticipation compensates."""
        seen, acted = (float(self.options.get(k, 0.0)) for k in ("seen_late", "acted_late"))
        return seen, acted


NOISY, WEAK = {"noise": 0.007}, {"thrust": 0.8}
SEEN, ACTED = {"seen_late": 0.4}, {"acted_late": 0.4}
CONDITIONS = {
    "nominal": Condition("nothing is late, noisy or weak", {}),
    "noise": Condition("±7 mm on positions", NOISY),
    "seen": Condition("positions 0.4 s late", SEEN),
    "acted": Condition("commands 0.4 s late", ACTED),
    "both": Condition("positions and commands 0.4 s late, each", {**SEEN, **ACTED}),
    "weak": Condition("thrust x 0.8", WEAK),
    "all": Condition("±7 mm, positions 0.4 s late, thrust x 0.8", {**NOISY, **SEEN, **WEAK}),
    "all_both": Condition("the same, and commands 0.4 s late", {**NOISY, **SEEN, **ACTED, **WEAK}),
    "pool": Condition("the system pool_tracking", {}, "pool_tracking"),
    "pool_weak": Condition("the same, thrust x 0.8", WEAK, "pool_tracking"),
}


@dataclass(frozen=True)
class Judged:
    """Results of one way and seed by condition, "as it is" and "anticipated"."""

    way: str
    seed: int
    cpu: float  # s, of learning
    returns: Mapping[tuple[str, str], NDArray[np.float64]]  # (episodes,)
    track: Mapping[tuple[str, str], NDArray[np.float64]]
    means: Mapping[tuple[str, str], Mapping[str, float]]  # dist [m], viol, clean


def run_transfers(
    seeds: int, results: Path, work: Path, *, ways: tuple[str, ...] = tuple(WAYS),
    conditions: tuple[str, ...] = tuple(CONDITIONS), **hooks: Unpack[Hooks],
) -> list[str]:  # fmt: skip
    """Train and judge the missing ways, seed by seed; returns their names, "dt-0".

    Raises KeyboardInterrupt if it is interrupted; the same call resumes.
    """
    missing = lacking_transfers(seeds, results, ways)
    for name, seed in missing:
        run_transfer(name, seed, results, work, conditions=conditions, **hooks)
    return [f"{name}-{seed}" for name, seed in missing]


def lacking_transfers(
    seeds: int, results: Path, ways: tuple[str, ...] = tuple(WAYS)
) -> list[tuple[str, int]]:
    """Return the ways and seeds without a result; a way without random numbers has one seed."""
    return [
        (name, seed)
        for seed in range(seeds)
        for name in ways
        if (WAYS[name].algorithm or not seed) and not (results / f"{name}-{seed}.json").is_file()
    ]


def run_transfer(
    name: str,
    seed: int,
    results: Path,
    work: Path,
    *,
    observers: tuple[TrainingObserver, ...] = (),
    interrupted: Callable[[], bool] | None = None,
    begins: Callable[[str], None] | None = None,
    conditions: tuple[str, ...] = tuple(CONDITIONS),
    episodes: int = 100,
) -> Path:
    """Train one way with one seed, judge it under each condition; returns the file of results."""
    way, report = WAYS[name], begins or (lambda _: None)
    report(f"{way.words}, seed {seed}")
    policies, cpu = _learned(way, seed, work / f"{name}-{seed}", observers, interrupted)
    cells = {}
    for condition in conditions:
        for how in ("as it is", "anticipated"):
            report(f"{name}, seed {seed}: {condition}, {how}")
            found = _judged(policies, CONDITIONS[condition], how, episodes)
            if found is not None:
                cells[f"{condition}/{how}"] = found
            if interrupted is not None and interrupted():
                raise KeyboardInterrupt
    content = {"uuvsim_transfer": 1, "version": __version__, "way": name, "seed": seed,
               "learned": way.words, "cpu": round(cpu, 1), "judged": cells}  # fmt: skip
    file = results / f"{name}-{seed}.json"
    results.mkdir(parents=True, exist_ok=True)
    write_whole(file, (json.dumps(content) + "\n").encode())
    return file


def read_transfers(results: Path) -> list[Judged]:
    """Read all results by way and seed; raises InputInvalid for a file without results."""
    found = []
    for path in sorted(results.glob("*.json")):
        try:
            read = json.loads(path.read_text(encoding="utf-8"))
            if read["uuvsim_transfer"] != 1:
                raise ValueError("of a later version")
            cells = {
                (condition, how): values
                for key, values in read["judged"].items()
                for condition, _, how in (key.partition("/"),)
            }
            returns, track = (
                {k: np.array(v[name], float) for k, v in cells.items()}
                for name in ("return", "track")
            )
            if not all(np.isfinite(v).all() and v.size for v in returns.values()):
                raise ValueError("returns that are no numbers")
            means = {
                k: {name: float(v[name]) for name in ("dist", "viol", "clean")}
                for k, v in cells.items()
            }
            found.append(
                Judged(read["way"], int(read["seed"]), float(read["cpu"]), returns, track, means)
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputInvalid(
                path, f"{type(error).__name__}: {error}", "a result of `uuvsim reproduce fig11`"
            ) from None
    order = list(WAYS)
    return sorted(found, key=lambda j: (order.index(j.way) if j.way in order else 99, j.seed))


# ---- inside -------------------------------------------------------------------------------


def _learned(
    way: Way, seed: int, place: Path, observers: tuple[TrainingObserver, ...],
    interrupted: Callable[[], bool] | None,
) -> tuple[list[Policy], float]:  # fmt: skip
    """Return the policies of a way and its CPU time [s], read from `place` if it is finished."""
    if not way.algorithm:
        return [], 0.0
    finished = place / "cpu.json"  # written last
    if not finished.is_file():
        if way.steps:
            from uuvsim_cosim.learn.training.train import train

            cpu = train(
                way.task, folder=place, algorithm=way.algorithm, seed=SEEDS_APART * seed, envs=64,
                steps=way.steps, task_options=dict(way.options), evaluate_every=6_400,
                tensorboard=False, settings={"updates": 4}, observers=observers,
                interrupted=interrupted,
            ).cpu  # fmt: skip
        else:
            cpu = _learned_from_data(way, seed, place, interrupted)
        write_whole(finished, json.dumps({"cpu": cpu}).encode())
    return load_policies(place), float(json.loads(finished.read_text())["cpu"])


def _learned_from_data(
    way: Way, seed: int, place: Path, interrupted: Callable[[], bool] | None
) -> float:
    from uuvsim_cosim.learn.data.collect import collect
    from uuvsim_cosim.learn.offline.offline import train_offline

    def check(*_: object) -> None:
        if interrupted is not None and interrupted():
            raise KeyboardInterrupt

    # It cannot be resumed, so it starts again. Of two processes, the first to finish is kept.
    part = place.with_name(f"{place.name}.part-{os.getpid()}")
    shutil.rmtree(part, ignore_errors=True)
    data = collect(way.task, "scripted", EPISODES)
    done = train_offline(data, way.algorithm, seed=SEEDS_APART * seed, folder=part, progress=check)
    if done.interrupted:
        shutil.rmtree(part)
        raise KeyboardInterrupt
    if place.exists():
        shutil.rmtree(part)
    else:
        part.rename(place)
    return done.cpu


def _judged(
    policies: list[Policy], condition: Condition, how: str, episodes: int
) -> dict[str, object] | None:
    """Judge under a condition; return None for "anticipated" without delays."""
    options = dict(condition.options)
    anticipated = how == "anticipated"
    if condition.task == "pool_tracking":
        options["predicted"] = anticipated
    elif anticipated and not any(condition.late):
        return None
    task = make_task(condition.task, options)
    assert isinstance(task, TeamTask)
    acts = acting_in(task, policies, condition.task) if policies else scripted_policy(task)
    if anticipated and condition.task != "pool_tracking" and isinstance(acts, Mapping):
        acts = {agent: Anticipating(act, *condition.late) for agent, act in acts.items()}
    judged = evaluate(task, acts, episodes, seed=JUDGING_SEED)
    summary = judged.summary()
    return {
        "return": [float(f"{x:.4g}") for x in judged.returns],
        "track": [float(f"{x:.3g}") for x in judged.metrics["track"]],
        **{k: float(f"{summary[k]:.4g}") for k in ("dist", "viol", "clean")},
    }
