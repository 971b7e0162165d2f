"""Training through a curriculum, stage by stage, in a folder from which it can be resumed."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.registry import ALGORITHMS, check_settings, default_settings
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.agents import widths
from uuvsim_cosim.learn.training.curriculum import Curriculum, Stage
from uuvsim_cosim.learn.training.curriculum_folder import (
    begin_anew,
    done_in,
    stage_folder,
    write_done,
)
from uuvsim_cosim.learn.training.curriculum_stage import (
    keep_switch,
    settings_of,
    switch_of,
    train_stage,
)
from uuvsim_cosim.learn.training.events import Events
from uuvsim_cosim.learn.training.folder_lock import locked
from uuvsim_cosim.learn.training.train import one_thread

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.training import TrainingObserver

__all__ = ["StageTrained", "train_curriculum"]


@dataclass(frozen=True)
class StageTrained:
    """The results of a stage, from its folder."""

    folder: Path
    task: str
    evaluations: Sequence[Mapping[str, float]]  # one row each, the first before learning
    scripted: float | None  # return of the hand-written controller, on the same episodes
    promoted: bool
    cpu: float  # s, evaluations included, all calls together
    note: str | None = None  # why nothing was learned, where that is so


def train_curriculum(
    curriculum: Curriculum,
    folder: str | Path,
    *,
    seed: int = 0,
    restart: bool = False,
    observers: tuple[TrainingObserver, ...] = (),
    interrupted: Callable[[], bool] | None = None,
    stage_begins: Callable[[int, Stage], None] | None = None,
    stage_ends: Callable[[int, StageTrained], None] | None = None,
    first: int | None = None,
    tensorboard: bool = True,
) -> list[StageTrained]:
    """Train through a curriculum, or resume it, in `folder`; a resumed one has the same bits.

    Each stage is a Training in its own folder, "2-transition_1"; switch.pt there is the state that
    it began with. A finished stage is not repeated. The folder is locked for this process, and
    torch computes on one thread. With `restart`, another curriculum in the folder is replaced.
    `first` is the first seed of the environments, see `Training`.
    """
    folder = Path(folder)
    tasks = [_task(curriculum, k) for k in range(len(curriculum.stages))]  # all checks come first
    _check_settings(curriculum, tasks)
    _check_widths(curriculum, tasks)
    done_in(folder, curriculum, seed, restart=restart)  # a refused folder gets no lock file
    results: list[StageTrained] = []
    with one_thread() as stack, locked(folder):
        done = done_in(folder, curriculum, seed, restart=restart)
        if restart:
            begin_anew(folder)
        if not done:
            write_done(folder, curriculum, seed, done)
        for k, (stage, task) in enumerate(zip(curriculum.stages, tasks, strict=True)):
            place = stage_folder(folder, k, stage.task)
            last_one = k + 1 == len(tasks)
            if k < len(done) and (last_one or switch_of(folder, curriculum, k + 1).is_file()):
                results.append(_result(place, stage, done[k]))
                continue
            if stage_begins is not None:
                stage_begins(k, stage)
            watching = observers
            if tensorboard and Events.possible():
                watching = (*observers, stack.enter_context(Events(place)))
            row, learner = train_stage(
                curriculum, k, task, place, seed, watching, interrupted, first
            )
            done = [*done[:k], row]
            results.append(_result(place, stage, row))
            if not last_one:  # before the record: a recorded stage has what the next one needs
                keep_switch(curriculum, k + 1, tasks[k + 1], learner, folder, seed)
            write_done(folder, curriculum, seed, done)
            if stage_ends is not None:
                stage_ends(k, results[-1])
    return results


# ---- inside -------------------------------------------------------------------------------


def _result(place: Path, stage: Stage, row: Mapping[str, Any]) -> StageTrained:
    path = place / "evaluations.csv"
    try:
        with path.open(newline="") as file:
            rows = [{k: float(v) for k, v in r.items() if v} for r in csv.DictReader(file)]
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise InputInvalid(
            path, f"cannot be read ({error})", "what a stage that is done has left"
        ) from None
    return StageTrained(
        place,
        stage.task,
        rows,
        row["scripted"],
        bool(row["promoted"]),
        float(row["cpu"]),
        row.get("note"),
    )


def _task(curriculum: Curriculum, k: int) -> Task | TeamTask:
    stage = curriculum.stages[k]
    try:
        return make_task(stage.task, {**curriculum.options, **stage.options})
    except InputInvalid as error:
        raise InputInvalid(f"curriculum {curriculum.name}, stage {k + 1}: {error}") from None


def _check_widths(curriculum: Curriculum, tasks: Sequence[Task | TeamTask]) -> None:
    seen = [widths(task) for task in tasks]
    for k, (width, acted) in enumerate(seen):
        if (width, acted) != seen[0]:
            raise InputInvalid(
                f"curriculum {curriculum.name}, stage {k + 1}",
                f"observes {width} numbers and acts on {acted}",
                (
                    f"{seen[0][0]} and {seen[0][1]}, as the first stage (target "
                    "tracking has an option slots)"
                ),
            )


def _check_settings(curriculum: Curriculum, tasks: Sequence[Task | TeamTask]) -> None:
    """Check that all settings exist, and that no switch changes the networks' shapes."""
    settings = []
    for k in range(len(curriculum.stages)):
        try:
            given = check_settings(ALGORITHMS[curriculum.algorithm], settings_of(curriculum, k))
        except InputInvalid as error:
            raise InputInvalid(f"curriculum {curriculum.name}, stage {k + 1}: {error}") from None
        if given.get("mirror") and not tasks[k].symmetries():
            raise InputInvalid(
                f"curriculum {curriculum.name}, stage {k + 1}",
                f"mirror: {curriculum.stages[k].task} has no symmetry",
                "mirror=false",
            )
        settings.append(given)
    from uuvsim_cosim.learn.algorithms.transfer import SHAPES

    defaults = default_settings(curriculum.algorithm)
    for name in (n for n in SHAPES if n in defaults):
        values = [s.get(name, defaults[name]) for s in settings]
        for k, value in enumerate(values):
            if value != values[0]:
                raise InputInvalid(
                    f"curriculum {curriculum.name}, stage {k + 1}",
                    f"{name} {value!r}",
                    f"{values[0]!r}, as in the first stage",
                )
