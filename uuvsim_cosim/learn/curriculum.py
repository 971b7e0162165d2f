"""A curriculum: tasks one after the other, each begun with what was learned in the last.

Scenario transfer training (STT) of the UUVSim paper is one; at each switch the actions are exactly
unchanged (see `transfer`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.envs.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms import ALGORITHMS, check_settings
from uuvsim_cosim.learn.claim import held
from uuvsim_cosim.learn.config import merged
from uuvsim_cosim.learn.curriculum_folder import begin_anew, done_in, stage_folder, write_done
from uuvsim_cosim.learn.curriculum_stage import keep_switch, settings_of, switch_of, train_stage
from uuvsim_cosim.learn.events import Events
from uuvsim_cosim.learn.task_ids import make_task
from uuvsim_cosim.learn.train import one_thread, widths

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training import TrainingObserver

__all__ = [
    "Curriculum",
    "Promotion",
    "Stage",
    "StageTrained",
    "train_curriculum",
]


@dataclass(frozen=True)
class Promotion:
    """When a stage is done before its steps are: so good in so many evaluations running."""

    share: float | None = 0.9  # of the scripted return
    least: float | None = None  # a return; instead of a share, where nothing is scripted
    evaluations: int = 2  # running


@dataclass(frozen=True)
class Stage:
    """One task of a curriculum, for at most `steps` environment steps."""

    task: str  # a name of TASKS, or "package.module:Name"
    steps: int  # environment steps, of all environments together
    options: Mapping[str, Any] = field(default_factory=dict)  # the task's own
    settings: Mapping[str, Any] = field(default_factory=dict)  # how experience becomes updates
    promotion: Promotion | None = None
    evaluate_every: int | None = None  # environment steps, instead of the curriculum's


@dataclass(frozen=True)
class Curriculum:
    """Stages in their order, and what they share; the same one gives the same bits."""

    name: str
    stages: tuple[Stage, ...]
    algorithm: str = "masac"  # or isac; with one agent it is sac
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the algorithm
    options: Mapping[str, Any] = field(default_factory=dict)  # of every task
    envs: int = 64
    evaluate_every: int = 6_400  # environment steps
    evaluation_episodes: int = 100

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if not self.stages:
            raise InputInvalid(f"curriculum {self.name}: no stages; expected at least one")
        if self.algorithm not in ("masac", "isac"):
            kind = "transfers nothing" if self.algorithm in ALGORITHMS else "no such algorithm"
            raise InputInvalid(f"algorithm {self.algorithm!r}: {kind}; expected masac or isac")
        for name in ("envs", "evaluate_every", "evaluation_episodes"):
            _whole(f"curriculum {self.name}, {name}", getattr(self, name))
        for k, stage in enumerate(self.stages):
            place = f"curriculum {self.name}, stage {k + 1}"
            _whole(f"{place}, steps", stage.steps)
            if stage.evaluate_every is not None:
                _whole(f"{place}, evaluate_every", stage.evaluate_every)
            if stage.promotion is not None:
                _check(place, stage.promotion)

    def changed(self, **changes: Any) -> Curriculum:
        """Give the same with changes, which come after what each stage says.

        Options and settings are added to those that are there.
        """
        given = {name: changes.pop(name, {}) for name in ("options", "settings")}
        stages = []
        for stage in changes.pop("stages", self.stages):
            before = {**self.options, **stage.options}
            options = {k: v for k, v in merged(before, given["options"]).items()
                       if k in stage.options or k in given["options"]}  # fmt: skip
            every = None if "evaluate_every" in changes else stage.evaluate_every
            settings = {**stage.settings, **given["settings"]}
            stages.append(replace(stage, options=options, settings=settings, evaluate_every=every))
        return replace(self, stages=tuple(stages), **changes)

    def plain(self) -> dict[str, Any]:
        """Give it as JSON knows it."""
        return dict(json.loads(json.dumps(asdict(self))))


@dataclass(frozen=True)
class StageTrained:
    """What a stage left in its folder."""

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
    """Train through a curriculum, or go on with it, in `folder`; to the same bits.

    Each stage is a Training in a folder of its own, "2-transition_1"; switch.pt there is what it
    began with. A stage that is done is not done again. The folder is this process's meanwhile, and
    torch computes on one thread. `restart` begins anew where another curriculum is; `first` is of
    environments' seeds, as `Training` has it.
    """
    folder = Path(folder)
    tasks = [_task(curriculum, k) for k in range(len(curriculum.stages))]  # all mistakes first
    _check_settings(curriculum, tasks)
    _check_widths(curriculum, tasks)
    done_in(folder, curriculum, seed, restart=restart)  # what it refuses, the lock has not touched
    results: list[StageTrained] = []
    with one_thread() as stack, held(folder):
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
            if not last_one:
                keep_switch(curriculum, k + 1, tasks[k + 1], learner, folder, seed)
            write_done(folder, curriculum, seed, done)
            if stage_ends is not None:
                stage_ends(k, results[-1])
    return results


# ---- inside -------------------------------------------------------------------------------


def _result(place: Path, stage: Stage, row: Mapping[str, Any]) -> StageTrained:
    import csv

    path = place / "evaluations.csv"
    try:
        with path.open(newline="") as file:
            rows = [{k: float(v) for k, v in r.items() if v} for r in csv.DictReader(file)]
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise InputInvalid(
            f"{path}: cannot be read ({error}); expected what a stage that is done has left"
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
                f"curriculum {curriculum.name}, stage {k + 1}: observes {width} numbers and acts "
                f"on {acted}; expected {seen[0][0]} and {seen[0][1]}, as the first stage (target "
                "tracking has an option slots)"
            )


def _check_settings(curriculum: Curriculum, tasks: Sequence[Task | TeamTask]) -> None:
    """Refuse settings that are none, or that would change the networks' shapes on the way."""
    settings = []
    for k in range(len(curriculum.stages)):
        try:
            given = check_settings(ALGORITHMS[curriculum.algorithm], settings_of(curriculum, k))
        except InputInvalid as error:
            raise InputInvalid(f"curriculum {curriculum.name}, stage {k + 1}: {error}") from None
        if given.get("mirror") and not tasks[k].symmetries():
            raise InputInvalid(
                f"curriculum {curriculum.name}, stage {k + 1}: mirror: {curriculum.stages[k].task} "
                "has no symmetry; expected mirror=false"
            )
        settings.append(given)
    from uuvsim_cosim.learn.masac import MasacSettings
    from uuvsim_cosim.learn.transfer import SHAPES

    for name in SHAPES:
        values = [s.get(name, getattr(MasacSettings, name)) for s in settings]
        for k, value in enumerate(values):
            if value != values[0]:
                raise InputInvalid(
                    f"curriculum {curriculum.name}, stage {k + 1}: {name} {value!r}; expected "
                    f"{values[0]!r}, as in the first stage"
                )


def _whole(name: str, value: Any) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < 1:
        raise InputInvalid(f"{name} {value!r}; expected a whole number from 1")


def _check(place: str, rule: Promotion) -> None:
    _whole(f"{place}, promotion, evaluations", rule.evaluations)
    given = [f.name for f in fields(rule)[:2] if getattr(rule, f.name) is not None]
    if len(given) != 1:
        raise InputInvalid(f"{place}, promotion: {given or 'nothing'}; expected share or least")
    value = getattr(rule, given[0])
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputInvalid(f"{place}, promotion, {given[0]} {value!r}; expected a number")
