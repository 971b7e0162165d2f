"""`uuvsim train … --curriculum stt`: task after task, each from the policy of the last one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from uuvsim_cosim.commands.learn.training_progress import TrainingProgress
from uuvsim_cosim.commands.shared.terminal import (
    file_line,
    line,
    notice,
    number,
    remark,
    table,
    tilde,
)
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.training_seeds import EVALUATION_SEED

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.train_curriculum import StageTrained

__all__ = ["train_through"]

SHOWN = ("return", "track", "dist", "viol", "clean")


def train_through(
    name: str,
    task: str | None,
    changes: Mapping[str, Any],
    out: Path | None,
    *,
    restart: bool,
    report: bool,
    show: bool,
    refused: Sequence[str],
) -> None:
    """Train through a curriculum with the options of `uuvsim train`.

    `changes` are fields of TrainingConfig that override the curriculum's. `refused` are given
    options that a curriculum does not have. `task` must be the last task of the curriculum.
    """
    if refused:
        raise InputInvalid(refused[0], "of one training", "--curriculum without it")
    from uuvsim_cosim.learn.training.curricula import curriculum_of
    from uuvsim_cosim.learn.training.interruption import Interruption
    from uuvsim_cosim.learn.training.train_curriculum import train_curriculum

    curriculum = curriculum_of(name)
    last = curriculum.stages[-1].task
    if task not in (None, "target-tracking", last):
        raise InputInvalid(
            f"task {task!r}", f"curriculum {curriculum.name} ends with {last}", "that, or none"
        )
    given = {k: v for k, v in changes.items() if v not in (None, {})}
    seed = given.pop("seed", 0)
    if not 0 <= seed < EVALUATION_SEED:
        raise InputInvalid(f"--seed {seed}: expected 0 … {EVALUATION_SEED - 1}")
    options = dict(given.pop("task_options", {}))
    if given.get("profile"):
        options["profile"] = given.pop("profile")
    if "steps" in given:
        raise InputInvalid(
            "--steps: of one training", "the steps of each stage, in a YAML file of a curriculum"
        )
    curriculum = curriculum.changed(options=options, **given)
    folder = out or Path("runs") / "train" / f"{curriculum.name}-{curriculum.algorithm}-{seed}"
    interruption = Interruption()
    with TrainingProgress() as progress:
        try:
            with interruption:
                done = train_curriculum(
                    curriculum, folder, seed=seed, restart=restart, observers=(progress,),
                    interrupted=interruption,
                    stage_begins=lambda k, s: progress.say(f"stage {k + 1}, {s.task}"),
                )  # fmt: skip
            written = None
            if report:
                from uuvsim_cosim.commands.learn.training_judged import write_judged
                from uuvsim_cosim.view.reports.training_report import write_curriculum_report

                progress.say("judging the best policy of the last stage, and drawing it")
                write_judged(folder)
                written = write_curriculum_report(folder, [stage.folder for stage in done])
        except KeyboardInterrupt:
            progress.close()
            notice("interrupted; the same command goes on from there")
            raise typer.Exit(interruption.status) from None
    _show(done, folder, written)
    if show and written is not None:
        typer.launch(str(written))


def _show(done: Sequence[StageTrained], folder: Path, report: Path | None) -> None:
    line()
    rows = []
    for stage in done:
        first, last = stage.evaluations[0], stage.evaluations[-1]
        scripted = "" if stage.scripted is None else number(stage.scripted, ".4g")
        rows.append(
            [stage.task, number(last["step"], ".0f"), number(stage.cpu, ".0f"),
             number(first["return"], ".4g"), scripted,
             *(number(last[k], ".4g") if k in last else "" for k in SHOWN),
             "promoted" if stage.promoted else "all steps"]
        )  # fmt: skip
    table(("stage", "steps", "CPU s", "first", "scripted", *SHOWN, "ended by"), rows, key="stages")
    for k, stage in enumerate(done):
        if stage.note is not None:
            remark("note", f"stage {k + 1}, {stage.task}: {stage.note}")
    line()
    file_line(report or folder, f"written: {tilde(report or folder)}")
