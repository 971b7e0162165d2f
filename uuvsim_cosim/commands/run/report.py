"""`uuvsim report`: write the one-file report of a run or of two, or a run's static picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.terminal import console, file_line
from uuvsim_cosim.errors import InputInvalid

__all__ = ["report_command"]


def report_command(
    run: Annotated[Path, typer.Argument(help="Folder that `uuvsim run` wrote.")],
    other: Annotated[
        Path | None,
        typer.Argument(help="Folder of a second run: the report then compares both."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="report.html in the run's folder, compared_with_NAME.html for two; "
            ".svg: a picture of one run.",
        ),
    ] = None,
    page: Annotated[
        bool,
        typer.Option(
            "--page",
            help="Also write page.html, on which the run goes on in a browser from any time.",
        ),
    ] = False,
) -> None:
    """Write the report of a run, or of two: one HTML file that opens offline.

    It has figures of merit, plots that zoom, and every recorded signal.
    """
    suffix = ".html" if out is None else out.suffix.lower()
    if suffix not in (".html", ".htm", ".svg"):
        raise InputInvalid(out, f"ending {suffix!r} was read", ".html or .svg")
    if suffix == ".svg" and other is not None:
        raise InputInvalid(out, "a picture shows one run", ".html to compare two runs")
    if page and (suffix == ".svg" or other is not None):
        raise InputInvalid("--page with two runs or .svg", "the report of one run")
    with console(stderr=True).status("writing the report"):
        written = _written(run, other, out, suffix, page=page)
    file_line(written)
    if page:
        file_line(written.parent / "page.html")


def _written(run: Path, other: Path | None, out: Path | None, suffix: str, *, page: bool) -> Path:
    if suffix == ".svg":
        from uuvsim_cosim.view.reports.picture import write_run_picture

        return write_run_picture(run, out or "")
    if other is not None:
        from uuvsim_cosim.view.reports.run_comparison import write_comparison

        return write_comparison(run, other, out)
    from uuvsim_cosim.view.reports.run_report import write_report

    return write_report(run, out, page=page)
