"""`uuvsim report`: write the one-file report of a run again, or its static picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.terminal import line, size_of, tilde

__all__ = ["report_command"]


def report_command(
    run: Annotated[Path, typer.Argument(help="Folder that `uuvsim run` wrote.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="report.html in the run's folder; .svg: a picture."),
    ] = None,
) -> None:
    """Write the report of a run: one HTML file that opens offline, or a picture as SVG."""
    from uuvsim_cosim.view.run_report import write_report, write_run_picture

    if out is not None and out.suffix.lower() == ".svg":
        written = write_run_picture(run, out)
    else:
        written = write_report(run, out)
    line(f"{tilde(written)}  {size_of(written)}")
