"""`uuvsim report`: write the one-file report of a run again, or its static picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.terminal import file_line
from uuvsim_cosim.errors import InputInvalid

__all__ = ["report_command"]


def report_command(
    run: Annotated[Path, typer.Argument(help="Folder that `uuvsim run` wrote.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="report.html in the run's folder; .svg: a picture."),
    ] = None,
) -> None:
    """Write the report of a run: one HTML file that opens offline, or a picture as SVG."""
    if out is not None and out.suffix.lower() not in (".html", ".htm", ".svg"):
        raise InputInvalid(out, f"ending {out.suffix!r} was read", ".html or .svg")
    if out is not None and out.suffix.lower() == ".svg":
        from uuvsim_cosim.view.reports.picture import write_run_picture

        written = write_run_picture(run, out)
    else:
        from uuvsim_cosim.view.reports.run_report import write_report

        written = write_report(run, out)
    file_line(written)
