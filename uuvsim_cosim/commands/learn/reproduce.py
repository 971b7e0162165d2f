"""`uuvsim reproduce fig7`: run the missing trainings of a figure, plot it, judge the claims."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.learn.training_progress import TrainingProgress
from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.completion import of
from uuvsim_cosim.commands.shared.options import RAY, clustered
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import file_table, line, notice, table, tilde
from uuvsim_cosim.commands.shared.termination import Termination
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.learn.paper.ways import Budget

__all__ = ["reproduce_command"]

RESULTS = Path("docs") / "results" / "target_tracking"


def reproduce_command(
    figure: Annotated[
        str,
        typer.Argument(
            autocompletion=of("fig7", "fig8", "fig9", "fig11", "all"),
            help="Figure of the paper: fig7, fig8, fig9, fig11 or all.",
        ),
    ],
    budget: Annotated[
        str,
        typer.Option(
            "--budget",
            autocompletion=of("batched", "paper"),
            help="Length of a training; batched: 64 environments; paper: 200 episodes of one "
            "environment.",
        ),
    ] = "batched",
    seeds: Annotated[
        int, typer.Option("--seeds", help="Number of seeds; a verdict needs five.")
    ] = 5,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder of the results; new ones are added.")
    ] = RESULTS,
    work: Annotated[
        Path, typer.Option("--work", help="Folder of the checkpoints of interrupted trainings.")
    ] = Path("runs") / "reproduce",
    ray: Annotated[str | None, typer.Option("--ray", help=RAY)] = None,
    no_run: Annotated[
        bool, typer.Option("--no-run", help="Train nothing; use the stored results only.")
    ] = False,
    pack: Annotated[
        bool,
        typer.Option("--pack", help="Collect the stored results in one file, results.parquet."),
    ] = False,
) -> None:
    """Run the missing trainings of figures of the paper; write tables, figures and verdicts.

    An interrupted command continues when it is repeated.
    """
    from uuvsim_cosim.learn.paper.ways import BUDGETS, chains_of
    from uuvsim_cosim.learn.shared.errors import check_torch

    if budget not in BUDGETS:
        raise InputInvalid(f"--budget {budget}: expected {' or '.join(BUDGETS)}")
    if seeds < 1:
        raise InputInvalid(f"--seeds {seeds}: expected 1 or more")
    chains_of(figure)
    for option, folder in (("--out", out), ("--work", work)):
        if folder.exists() and not folder.is_dir():
            raise InputInvalid(f"{option} {folder}", "is a file", "a folder")
    if not no_run:
        check_torch()
        if ray is None:
            _run(figure, BUDGETS[budget], seeds, out, work)
        else:
            _run_on(ray, figure, BUDGETS[budget], seeds, out, work)
    from uuvsim_cosim.commands.learn.reproduce_report import write_report

    rows, files = write_report(out)
    if pack:
        from uuvsim_cosim.learn.paper.results import pack as packed

        files.append(packed(out))
    shown = [r for r in rows[budget] if figure == "all" or r.figure in (figure[3:], "all")]
    line()
    table(("figure", "claim", "measured", "verdict"),
          [(r.figure, r.claim, r.measured, r.text) for r in shown], key="claims")  # fmt: skip
    line()
    if answer().mode == "json":
        file_table(files)
    line(f"written: {', '.join(tilde(f) for f in files)}")


def _run(figure: str, budget: Budget, seeds: int, out: Path, work: Path) -> None:
    from uuvsim_cosim.learn.paper.reproduce import reproduce
    from uuvsim_cosim.learn.training.interruption import Interruption

    interruption = Interruption()
    with TrainingProgress() as progress:
        try:
            with interruption:
                reproduce(
                    figure, budget, seeds, out, work, observers=(progress,),
                    interrupted=interruption, begins=progress.say,
                )  # fmt: skip
                if figure in ("fig11", "all"):
                    from uuvsim_cosim.commands.learn.reproduce_report import FOLDER
                    from uuvsim_cosim.learn.paper.transfer_runs import run_transfers

                    run_transfers(
                        seeds, out / FOLDER, work / FOLDER, observers=(progress,),
                        interrupted=interruption, begins=progress.say,
                    )  # fmt: skip
        except KeyboardInterrupt:
            progress.close()
            notice("interrupted; repeat the command to continue")
            raise typer.Exit(interruption.status) from None


def _run_on(ray: str, figure: str, budget: Budget, seeds: int, out: Path, work: Path) -> None:
    from uuvsim_cosim.commands.learn.reproduce_report import FOLDER
    from uuvsim_cosim.learn.paper.ray_reproduce import reproduce_on, transfers_on
    from uuvsim_cosim.learn.training.ray_training import ALIKE

    with Termination() as termination, StudyProgress("ways and seeds") as progress:
        try:
            with clustered(ray, alike=ALIKE) as cluster:
                assert cluster is not None
                reproduce_on(cluster, figure, budget, seeds, out, work, progress=progress)
                if figure in ("fig11", "all"):
                    transfers_on(cluster, seeds, out / FOLDER, progress=progress)
        except KeyboardInterrupt:
            progress.close()
            notice("interrupted; repeat the command to continue")
            raise typer.Exit(termination.status) from None
