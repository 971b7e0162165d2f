"""`uuvsim export-policy`: export a policy as FMU, ONNX, PyTorch or NumPy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.options import fmi_version, platform_names
from uuvsim_cosim.commands.shared.terminal import console, file_line

__all__ = ["export_policy_command"]


def export_policy_command(
    policy: Annotated[
        Path, typer.Argument(help="A policy (.npz), or the folder of a training or curriculum.")
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="File to write: .fmu, .onnx, .pth or .py (numpy).")
    ],
    fmi: Annotated[int, typer.Option(help="FMI version of an .fmu: 2 or 3.")] = 3,
    platform: Annotated[
        str,
        typer.Option(
            help="Platforms of an .fmu, comma-separated: host, linux64, win64, darwin64, …"
        ),
    ] = "host,linux64,win64",
    plain: Annotated[
        bool, typer.Option("--plain", help="Export observation and action only, not a pilot.")
    ] = False,
) -> None:
    """Export a trained policy; the ending of the file name selects the format.

    A policy of target tracking becomes a pilot: `uuvsim run target_tracking --replace
    tracker_1.pilot=policy.fmu`. C sources are inside an .fmu.
    """
    from uuvsim_cosim.learn.deployment.export import export_policy

    version, platforms = fmi_version(fmi), platform_names(platform)
    with console(stderr=True).status(f"writing {out.name}"):
        written = export_policy(policy, out, fmi=version, platforms=platforms, plain=plain)
    for path in written:
        file_line(path)
