"""One stage of a curriculum: its learner, its training, and the start of the next stage."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.registry import algorithm_for, default_settings, learner_of
from uuvsim_cosim.learn.training.agents import agents_of, widths
from uuvsim_cosim.learn.training.curriculum import Curriculum, Stage
from uuvsim_cosim.learn.training.curriculum_folder import STAGE, SWITCH, stage_folder
from uuvsim_cosim.learn.training.training_seeds import EVALUATION_SEED

if TYPE_CHECKING:
    from uuvsim_cosim.envs.tasks.evaluation import Evaluation
    from uuvsim_cosim.learn.algorithms.learner import Transferable
    from uuvsim_cosim.learn.training.training import Training, TrainingObserver

__all__ = [
    "keep_switch",
    "learner_for",
    "settings_of",
    "spent",
    "switch_of",
    "train_stage",
]

CRITIC_ONLY = 500  # updates of the critics alone after a switch, where there are critics


def train_stage(
    curriculum: Curriculum, k: int, task: Task | TeamTask, place: Path, seed: int,
    observers: tuple[TrainingObserver, ...], interrupted: Callable[[], bool] | None,
    first: int | None,
) -> tuple[dict[str, Any], Transferable]:  # fmt: skip
    """Train stage k, or resume it; returns the record of the stage, and its learner."""
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
    promoted = bool(rows[-1]["stopped"])
    return {
        "scripted": scripted,
        "promoted": promoted,
        "cpu": before + training.cpu,
        "note": training.note,
    }, learner


def learner_for(curriculum: Curriculum, k: int, task: Task | TeamTask, seed: int) -> Transferable:
    """Make the new learner of a stage, without the networks of earlier stages."""
    agents = len(agents_of(task))
    observed, acted = widths(task)
    name = "sac" if agents == 1 and curriculum.algorithm == "masac" else curriculum.algorithm
    made: object = learner_of(
        algorithm_for(name, agents), settings_of(curriculum, k), agents=agents, observed=observed,
        acted=acted, n=curriculum.envs, seed=seed, symmetries=task.symmetries(),
    )  # fmt: skip
    return cast("Transferable", made)


def spent(about: Path) -> float:
    """Return the CPU seconds of earlier calls; 0 if they cannot be read."""
    try:
        return float(json.loads(about.read_text(encoding="utf-8"))["cpu"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0.0


def settings_of(curriculum: Curriculum, k: int) -> dict[str, object]:
    """Return the settings of stage k; after a switch, without random actions at the start."""
    algorithm, own = curriculum.algorithm, curriculum.stages[k].settings
    settings = {**curriculum.settings, **own}
    switched: dict[str, object] = {}  # PPO needs none: it explores by the deviation it has learned
    if k and algorithm in ("masac", "isac"):
        switched = {"warm_up": 0, "critic_only": CRITIC_ONLY}
    elif k and algorithm == "idqn":
        end = settings.get("epsilon_end", default_settings(algorithm)["epsilon_end"])
        switched = {"warm_up": 0, "epsilon": end}
    return {**curriculum.settings, **switched, **own}


def keep_switch(
    curriculum: Curriculum,
    k: int,
    task: Task | TeamTask,
    last: Transferable,
    folder: Path,
    seed: int,
) -> None:
    """Write the state with which stage k begins."""
    from uuvsim_cosim.learn.algorithms.checkpoint import save_checkpoint

    began = learner_for(curriculum, k, task, seed)
    began.go_on_from(last, seed)
    path = switch_of(folder, curriculum, k)
    path.parent.mkdir(parents=True, exist_ok=True)
    save_checkpoint(path, {"learner": began.state()})


def switch_of(folder: Path, curriculum: Curriculum, k: int) -> Path:
    """Return the file with which stage k begins."""
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
