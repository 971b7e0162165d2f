"""`uuvsim train … --curriculum stt`: task after task, each begun with what the last has taught."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from uuvsim_cosim.commands.terminal import line, table, tilde
from uuvsim_cosim.commands.training_progress import TrainingProgress
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.learn.curriculum import StageTrained

__all__ = ["train_through"]

SHOWN = ("return", "track", "dist", "viol", "clean")


def train_through(
    name: str,
    task: str | None,
    changes: Mapping[str, Any],
    out: Path | None,
    refused: Sequence[str] = (),
) -> None:
    """Train through a curriculum, as `uuvsim train`'s options say; those it has not are refused.

    `changes` are fields of TrainingConfig, `refused` options of one training that were given.
    `task` must be what the curriculum is about.
    """
    if refused:
        raise InputInvalid(f"{refused[0]}: of one training; expected --curriculum without it")
    from uuvsim_cosim.learn.curricula import curriculum_of
    from uuvsim_cosim.learn.curriculum import train_curriculum
    from uuvsim_cosim.learn.interruption import Interruption

    curriculum = curriculum_of(name)
    last = curriculum.stages[-1].task
    if task not in (None, "target-tracking", last):
        raise InputInvalid(
            f"task {task!r}: curriculum {curriculum.name} ends with {last}; expected that, or none"
        )
    given = {k: v for k, v in changes.items() if v not in (None, {})}
    seed = given.pop("seed", 0)
    options = dict(given.pop("task_options", {}))
    if given.get("profile"):
        options["profile"] = given.pop("profile")
    if "steps" in given:
        raise InputInvalid(
            "--steps: of one training; expected the steps of each stage, in a YAML file of a "
            "curriculum"
        )
    curriculum = curriculum.changed(options=options, **given)
    folder = out or Path("runs") / "train" / f"{curriculum.name}-{curriculum.algorithm}-{seed}"
    interruption = Interruption()
    with TrainingProgress() as progress:
        try:
            with interruption:
                done = train_curriculum(
                    curriculum, folder, seed=seed, observers=(progress,), interrupted=interruption,
                    stage_begins=lambda k, s: progress.say(f"stage {k + 1}, {s.task}"),
                )  # fmt: skip
        except KeyboardInterrupt:
            progress.close()
            sys.stderr.write("uuvsim: interrupted; the same command goes on from there\n")
            raise typer.Exit(interruption.status) from None
    _show(done, folder)


def _show(done: Sequence[StageTrained], folder: Path) -> None:
    line()
    rows = []
    for stage in done:
        first, last = stage.evaluations[0], stage.evaluations[-1]
        scripted = "" if stage.scripted is None else f"{stage.scripted:.4g}"
        rows.append(
            [stage.task, f"{last['step']:.0f}", f"{stage.cpu:.0f}", f"{first['return']:.4g}",
             scripted, *(f"{last[k]:.4g}" if k in last else "" for k in SHOWN),
             "promoted" if stage.promoted else "all steps"]
        )  # fmt: skip
    table(("stage", "steps", "CPU s", "first", "scripted", *SHOWN, "ended by"), rows)
    line()
    line(f"written: {tilde(folder)}")
