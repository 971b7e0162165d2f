"""`uuvsim study`: run a study file; write one table and a report."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.shared.options import RAY, clustered, folder_option
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.system_options import Force, Loops
from uuvsim_cosim.commands.shared.terminal import (
    file_table,
    line,
    notice,
    number,
    put,
    remark,
    table,
)
from uuvsim_cosim.commands.shared.termination import Termination
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.system.elements import Mismatches
    from uuvsim_cosim.studies import StudyResult

__all__ = ["study_command"]

MOST_POINTS = 24


def study_command(
    file: Annotated[
        Path, typer.Argument(help="Study file (YAML): system, parameters, seeds, metrics.")
    ],
    out: Annotated[Path | None, folder_option("Folder to write, or to continue.")] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", "-j", help="Number of threads or processes; default: number of cores."
        ),
    ] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Start again in a folder that holds another study.")
    ] = False,
    master: Annotated[
        bool, typer.Option("--master", help="Use masters even if a kernel can run the study.")
    ] = False,
    loops: Loops = None,
    force: Force = False,
    ray: Annotated[
        str | None,
        typer.Option("--ray", help=RAY),
    ] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in a browser.")] = False,
) -> None:
    """Run a study: one row per run in runs.parquet, intervals and pictures in report.html.

    An interrupted study continues with the same command.
    """
    if not file.is_file():
        raise InputInvalid(file, "no such file", "a study file (.yaml)")
    if jobs is not None and jobs < 1:
        raise InputInvalid(f"--jobs {jobs}: expected 1 or more")
    report = None
    with Termination() as termination, StudyProgress() as progress:
        try:
            from uuvsim_cosim.orchestrator.plan.flatten import flatten
            from uuvsim_cosim.studies import Study

            warn: Mismatches | None = "warn" if force else None
            study = Study.read(file, loops, warn)  # type: ignore[arg-type]  # others are refused
            with clustered(ray, jobs) as cluster:
                done = study.run(
                    out, jobs=jobs, restart=restart, backend="master" if master else "auto",
                    progress=progress, cluster=cluster,
                )  # fmt: skip
            if not no_report:
                from uuvsim_cosim.view.reports.study_report import write_study_report

                progress.say("writing the report")
                report = write_study_report(done.folder)
        except KeyboardInterrupt as interrupted:
            progress.close()
            notice(str(interrupted) or "interrupted; repeat the command to continue")
            raise typer.Exit(termination.status) from None
    _show(done, report, flatten(study.system).warnings if force else ())
    if open_ and report is not None:
        typer.launch(str(report))


def _show(done: StudyResult, report: Path | None, warnings: Collection[str]) -> None:
    line()
    by = {"kernel": "by a fused kernel", "master": "by masters"}.get(done.backend, "")
    counts = [f"{done.runs} runs {by}".rstrip(), f"{done.wall_time:.2f} s"]
    counts += [f"{done.resumed} from before"] if done.resumed else []
    counts += [f"{done.failed} failed"] if done.failed else []
    line(f"{done.name}: {', '.join(counts)}")
    axes = list(done.intervals[0]["at"]) if done.intervals else []
    rows = [
        (i["metric"], *(number(i['at'][a], "g") for a in axes), i["n"], number(i['mean'], ".4g"),
         "" if i["low"] != i["low"] else f"{i['low']:.4g} … {i['high']:.4g}")
        for i in sorted(done.intervals, key=lambda i: i["metric"])
    ]  # fmt: skip
    table(("metric", *axes, "runs", "mean", "95 % interval"), rows[:MOST_POINTS],
          key="intervals")  # fmt: skip
    put("intervals", done.intervals)
    put("runs", {"done": done.runs, "failed": done.failed, "resumed": done.resumed})
    if len(rows) > MOST_POINTS:
        line(f"and {len(rows) - MOST_POINTS} more, in study.json")
    for text in done.remarks:
        remark("warning" if text in warnings else "note", text)
    line()
    files = [done.file, *([report] if report else []), done.folder / "study.json"]
    file_table(files)
