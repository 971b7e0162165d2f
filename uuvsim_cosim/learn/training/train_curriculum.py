"""Training on the stages of a curriculum, in a folder from which it can be resumed."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.registry import (
    ALGORITHMS,
    check_settings,
    default_settings,
)
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.agents import agents_of, widths
from uuvsim_cosim.learn.training.curriculum import Curriculum, Stage
from uuvsim_cosim.learn.training.events import Events
from uuvsim_cosim.learn.training.folders import (
    STAGE,
    SWITCH,
    begin_anew,
    done_in,
    locked,
    stage_folder,
    write_done,
)
from uuvsim_cosim.learn.training.train import learner_in, one_thread
from uuvsim_cosim.learn.training.training_seeds import EVALUATION_SEED

if TYPE_CHECKING:
    from uuvsim_cosim.envs.tasks.evaluation import Evaluation
    from uuvsim_cosim.learn.algorithms.learner import Transferable
    from uuvsim_cosim.learn.training.training import Training, TrainingObserver

__all__ = ["StageTrained", "learner_for", "settings_of", "spent", "train_curriculum"]


@dataclass(frozen=True)
class StageTrained:
    """The results of a stage, from its folder."""

    folder: Path
    task: str
    evaluations: Sequence[Mapping[str, float]]  # one row each, the first before learning
    scripted: float | None  # return of the hand-written controller, on the same episodes
    promoted: bool
    cpu: float  # s, evaluations included, summed over all calls
    note: str | None = None  # the reason, if nothing was learned


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
    """Train on the stages of a curriculum in a folder, or resume it; return the stages' results.

    `curriculum` is a `Curriculum`, for example CURRICULA["stt"]. Each stage is a training in a
    folder of its own below `folder`, "2-transition_1"; the file switch.pt there holds the networks
    that the stage started from. A finished stage is not repeated, and an interrupted curriculum
    resumes with the same bits. `restart` starts from the beginning, and replaces another curriculum
    in the folder. `seed` is the seed of the learner and of the environments; `first` is the seed of
    the first environment, by default one that no training with another seed uses.

    `observers` receive the progress of each step. `stage_begins(number, stage)` and
    `stage_ends(number, result)` are called at each stage, numbers from 0. `interrupted` is called
    after each step; if it returns True, the step is saved and KeyboardInterrupt is raised. With
    `tensorboard`, curves are written for TensorBoard, too. The folder is locked for this process,
    and torch computes on one thread. Each result has the stage's `folder`, `task`, `evaluations`,
    the `scripted` return, whether it was `promoted`, `cpu` [s] and a `note` if nothing was learned.

    Needs the extra `rl`. Raises InputInvalid, before anything is trained, for wrong tasks, options
    or settings of a stage, and for stages whose networks or observations differ in size.

    Example:

    >>> from uuvsim_cosim.learn import Curriculum, Stage, train_curriculum
    >>> short = Curriculum(  # much too short to learn the tasks
    ...     "short",
    ...     (Stage("source", steps=160), Stage("transition_1", steps=160)),
    ...     settings={"hidden": 16, "batch": 16, "warm_up": 64},
    ...     envs=8,
    ...     evaluate_every=160,
    ...     evaluation_episodes=2,
    ... )
    >>> results = train_curriculum(short, "short")
    >>> [(stage.folder.name, stage.evaluations[-1]["step"]) for stage in results]
    [('1-source', 160.0), ('2-transition_1', 160.0)]
    """
    from uuvsim_cosim.learn.algorithms.checkpoint import save_checkpoint

    folder = Path(folder)
    tasks = _checked_tasks(curriculum)  # all checks come first
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
                following = learner_for(curriculum, k + 1, tasks[k + 1], seed)
                following.go_on_from(learner, seed)
                path = switch_of(folder, curriculum, k + 1)
                path.parent.mkdir(parents=True, exist_ok=True)
                save_checkpoint(path, {"learner": following.state()})
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
            path, f"cannot be read ({error})", "the results of a finished stage"
        ) from None
    promoted, cpu = bool(row["promoted"]), float(row["cpu"])
    return StageTrained(place, stage.task, rows, row["scripted"], promoted, cpu, row.get("note"))


def _checked_tasks(curriculum: Curriculum) -> list[Task | TeamTask]:
    """Make the tasks; check all settings, and that the networks of all stages have one shape."""
    from uuvsim_cosim.learn.algorithms.transfer import SHAPES

    tasks: list[Task | TeamTask] = []
    shapes: list[dict[str, object]] = []
    defaults = default_settings(curriculum.algorithm)
    algorithm = ALGORITHMS[curriculum.algorithm]
    places = [f"curriculum {curriculum.name}, stage {k + 1}" for k in range(len(curriculum.stages))]
    for place, stage in zip(places, curriculum.stages, strict=True):
        try:
            tasks.append(make_task(stage.task, {**curriculum.options, **stage.options}))
        except InputInvalid as error:
            raise InputInvalid(f"{place}: {error}") from None
    for k, (place, task) in enumerate(zip(places, tasks, strict=True)):
        try:
            settings = check_settings(algorithm, settings_of(curriculum, k))
        except InputInvalid as error:
            raise InputInvalid(f"{place}: {error}") from None
        if settings.get("mirror") and not task.symmetries():
            name = curriculum.stages[k].task
            raise InputInvalid(place, f"mirror: {name} has no symmetry", "mirror=false")
        shapes.append({n: settings.get(n, defaults[n]) for n in SHAPES if n in defaults})
    for name in shapes[0]:
        for place, shape in zip(places, shapes, strict=True):
            if shape[name] != shapes[0][name]:
                expected = f"{shapes[0][name]!r}, as in the first stage"
                raise InputInvalid(place, f"{name} {shape[name]!r}", expected)
    seen, acts = widths(tasks[0])
    for place, task in zip(places, tasks, strict=True):
        width, acted = widths(task)
        if (width, acted) != (seen, acts):
            raise InputInvalid(
                place,
                f"observes {width} numbers and acts on {acted}",
                f"{seen} and {acts}, as the first stage (target tracking has an option slots)",
            )
    return tasks


CRITIC_ONLY = 500  # updates of the critics alone after a switch, where there are critics


def train_stage(
    curriculum: Curriculum, k: int, task: Task | TeamTask, place: Path, seed: int,
    observers: tuple[TrainingObserver, ...], interrupted: Callable[[], bool] | None,
    first: int | None,
) -> tuple[dict[str, Any], Transferable]:  # fmt: skip
    """Train stage k, or resume it; return the record of the stage and its learner."""
    from uuvsim_cosim.learn.algorithms.checkpoint import load_checkpoint
    from uuvsim_cosim.learn.training.training import Training

    stage = curriculum.stages[k]
    learner = learner_for(curriculum, k, task, seed)
    if k:
        began = switch_of(place.parent, curriculum, k)
        read = load_checkpoint(began)
        try:
            learner.set_state(read["learner"])
        except InputInvalid as error:
            raise InputInvalid(f"{began}: {error}") from None
    scripted = _scripted(task, curriculum, stage)
    about = place / STAGE
    before = spent(about)
    training: Training | None = None

    def good(judged: Evaluation) -> bool:
        rule = stage.promotion
        assert training is not None
        past = [row["return"] for row in training.evaluations]
        returns = [*past, float(judged.returns.mean())]
        if rule is None or len(returns) < rule.evaluations:
            return False
        wanted = rule.least
        if wanted is None:
            assert scripted is not None
            assert rule.share is not None
            wanted = scripted - (1.0 - rule.share) * abs(scripted)
        return all(r >= wanted for r in returns[-rule.evaluations :])

    training = Training(
        task, learner, name=stage.task, options={**curriculum.options, **stage.options},
        n=curriculum.envs, seed=seed, steps=stage.steps, folder=place,
        evaluate_every=stage.evaluate_every or curriculum.evaluate_every, stop=good,
        interrupted=interrupted,
        evaluation_episodes=curriculum.evaluation_episodes, observers=observers, first=first,
    )  # fmt: skip
    try:
        rows = training.run()
    finally:
        training.close()
        place.mkdir(parents=True, exist_ok=True)
        write_whole(about, json.dumps({"cpu": before + training.cpu}).encode())
    return {
        "scripted": scripted,
        "promoted": bool(rows[-1]["stopped"]),
        "cpu": before + training.cpu,
        "note": training.note,
    }, learner


def learner_for(curriculum: Curriculum, k: int, task: Task | TeamTask, seed: int) -> Transferable:
    """Make the new learner of a stage, without the networks of earlier stages."""
    alone = len(agents_of(task)) == 1 and curriculum.algorithm == "masac"
    settings = settings_of(curriculum, k)
    name = "sac" if alone else curriculum.algorithm
    made: object = learner_in(task, name, settings, n=curriculum.envs, seed=seed)
    return cast("Transferable", made)


def spent(about: Path) -> float:
    """Return the CPU time of earlier calls [s]; 0 if it cannot be read."""
    try:
        return float(json.loads(about.read_text(encoding="utf-8"))["cpu"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0


def settings_of(curriculum: Curriculum, k: int) -> dict[str, object]:
    """Return the settings of stage k; a stage after a switch does not start with random actions."""
    algorithm, own = curriculum.algorithm, curriculum.stages[k].settings
    settings = {**curriculum.settings, **own}
    switched: dict[str, object] = {}  # PPO needs none: it keeps its standard deviations
    if k and algorithm in ("masac", "isac"):
        switched = {"warm_up": 0, "critic_only": CRITIC_ONLY}
    elif k and algorithm == "idqn":
        end = settings.get("epsilon_end", default_settings(algorithm)["epsilon_end"])
        switched = {"warm_up": 0, "epsilon": end}
    return {**curriculum.settings, **switched, **own}


def switch_of(folder: Path, curriculum: Curriculum, k: int) -> Path:
    """Return the file with the networks that stage k starts from."""
    return stage_folder(folder, k, curriculum.stages[k].task) / SWITCH


def _scripted(task: Task | TeamTask, curriculum: Curriculum, stage: Stage) -> float | None:
    from uuvsim_cosim.envs.tasks.evaluation import evaluate
    from uuvsim_cosim.envs.tasks.scripted import scripted_policy

    try:
        policy = scripted_policy(task)
    except InputInvalid as error:
        if stage.promotion is not None and stage.promotion.share is not None:
            raise InputInvalid(f"{error}; or a promotion by `least`, a return") from None
        return None
    judged = evaluate(task, policy, curriculum.evaluation_episodes, seed=EVALUATION_SEED)
    return float(judged.returns.mean())
