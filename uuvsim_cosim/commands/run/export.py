"""`uuvsim export`: a recording as CSV, MATLAB, MCAP (with its scene for Foxglove) or Rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.terminal import file_line
from uuvsim_cosim.errors import InputInvalid

__all__ = ["export_command"]

KINDS = (".csv", ".mat", ".mcap", ".rrd")


def export_command(
    run: Annotated[Path, typer.Argument(help="Folder that `uuvsim run` wrote, or a recording.")],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="File to write: .csv, .mat, .mcap or .rrd (Rerun).")
    ],
    scene: Annotated[
        bool, typer.Option("--scene", help="With .mcap: the 3-D scene as well, for Foxglove.")
    ] = False,
) -> None:
    """Convert a recording for other tools; the ending of the file's name decides the format."""
    kind = out.suffix.lower()
    if kind not in KINDS:
        raise InputInvalid(out, f"ending {out.suffix!r} was read", ", ".join(KINDS))
    if scene and kind != ".mcap":
        raise InputInvalid(f"--scene and {out}: expected a file .mcap; .rrd has the scene anyway")
    if kind == ".rrd":
        from uuvsim_cosim.view.scene3d.rerun_file import export_rrd

        export_rrd(run, out)
    elif scene:
        from uuvsim_cosim.view.scene3d.foxglove import export_scene_mcap

        export_scene_mcap(run, out)
    else:
        from uuvsim_cosim.orchestrator.recording.export import export

        export(run, out)
    file_line(out)
