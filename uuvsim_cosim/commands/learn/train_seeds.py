"""`uuvsim train … --seeds 5`: one training under several seeds, in turn or on a Ray cluster."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from uuvsim_cosim.commands.shared.options import clustered
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import line, notice, number, table, tilde
from uuvsim_cosim.commands.shared.termination import Termination
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.config import TrainingConfig
    from uuvsim_cosim.learn.training.train import Trained
    from uuvsim_cosim.learn.training.training import Progress

__all__ = ["seeds_of", "train_seeds"]

MOST = 10_000


def seeds_of(text: str, first: int = 0) -> list[int]:
    """Read ``5``, a number of seeds from `first`, or a list ``3,7,11``; raises InputInvalid."""
    wrong = InputInvalid(
        f"--seeds {text}: expected a number of them, 1 … {MOST}, or distinct seeds as 3,7,11"
    )
    try:
        read = [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise wrong from None
    if "," not in text and read:
        if not 1 <= read[0] <= MOST:
            raise wrong
        return list(range(first, first + read[0]))
    if not read or len(set(read)) != len(read) or len(read) > MOST:
        raise wrong
    return read


def train_seeds(
    configs: Sequence[TrainingConfig], folders: Sequence[Path], restart: bool, report: bool,
    ray: str | None,
) -> list[Trained]:  # fmt: skip
    """Train each in its folder; write a report of each, and a table of all."""
    with Termination() as termination, StudyProgress("steps") as progress:
        try:
            progress.say("building, once")
            done = _trained(configs, folders, restart, ray, progress)
            from uuvsim_cosim.commands.learn.training_judged import write_judged
            from uuvsim_cosim.view.reports.training_report import write_training_report

            for k, each in enumerate(done if report else ()):
                progress.say(f"judging the best policy of {k + 1} of {len(done)}, and drawing it")
                write_judged(each.folder)
                write_training_report(each.folder)
        except KeyboardInterrupt as interrupted:
            progress.close()
            message = str(interrupted) or "interrupted; the same command goes on from there"
            notice(message)
            status = max(termination.status, getattr(interrupted, "status", 130))
            raise typer.Exit(status) from None
    _show(done)
    return done


def _trained(
    configs: Sequence[TrainingConfig], folders: Sequence[Path], restart: bool, ray: str | None,
    progress: StudyProgress,
) -> list[Trained]:  # fmt: skip
    if ray is not None:
        from uuvsim_cosim.learn.training.ray_training import ALIKE, train_on

        with clustered(ray, alike=ALIKE) as cluster:
            assert cluster is not None
            return train_on(cluster, configs, folders, restart=restart, progress=progress)
    from uuvsim_cosim.learn.training.train import train

    total = sum(c.steps for c in configs)
    done: list[Trained] = []
    for config, folder in zip(configs, folders, strict=True):
        seen = _Seen(progress, sum(d.config.steps for d in done), total)
        done.append(train(config, folder=folder, restart=restart, observers=(seen,)))
    return done


class _Seen:
    """A TrainingObserver that shows one training's part of the total progress."""

    def __init__(self, progress: StudyProgress, before: float, total: float) -> None:
        self._progress, self._before, self._total = progress, before, total

    def __call__(self, progress: Progress) -> None:
        self._progress("training", self._before + progress.step, self._total)


def _show(done: Sequence[Trained]) -> None:
    line()
    first = done[0].config
    line(f"{first.task}, {first.algorithm}: {len(done)} trainings")
    names = [k for k in ("track", "clean", "success") if k in done[0].evaluations[-1]]
    rows = []
    for each in done:
        best = max(each.evaluations, key=lambda row: row["return"])
        rows.append(
            (each.config.seed, number(each.cpu, ".1f"), number(best["step"], ".0f"),
             number(best["return"], ".4g"),
             *(number(best[k], ".4g") for k in names), tilde(each.folder))
        )  # fmt: skip
    table(("seed", "CPU s", "best at step", "return", *names, "written"), rows, key="trainings")
    for each in done:
        if each.note is not None:
            line(f"seed {each.config.seed}: {each.note}")
