"""`uuvsim export`: a recording as CSV, MATLAB or MCAP."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.terminal import line, size_of, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["export_command"]

KINDS = (".csv", ".mat", ".mcap")


def export_command(
    run: Annotated[Path, typer.Argument(help="Folder that `uuvsim run` wrote, or a recording.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .csv, .mat or .mcap.")],
) -> None:
    """Convert a recording for other tools; the ending of the file's name says to what."""
    if out.suffix.lower() not in KINDS:
        raise InputInvalid(f"{out}: ending {out.suffix!r} was read; expected {', '.join(KINDS)}")
    from uuvsim_cosim.orchestrator.recording import export

    export(run, out)
    line(f"{tilde(out)}  {size_of(out)}")
