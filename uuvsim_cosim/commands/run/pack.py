"""`uuvsim pack`: a system as plain SSP, with its FMUs inside."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import systems
from uuvsim_cosim.commands.shared.options import fmi_version, platform_names
from uuvsim_cosim.commands.shared.terminal import console, file_line, remark
from uuvsim_cosim.errors import InputInvalid

__all__ = ["pack_command"]


def pack_command(
    system: Annotated[
        str,
        typer.Argument(autocompletion=systems, help="Name of a system, or an .ssd or .ssp file."),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write (.ssp).")],
    fmi: Annotated[
        int, typer.Option(help="FMI version: 2 (FMI 2 in SSP 1.0) or 3 (FMI 3 in SSP 2.0).")
    ] = 2,
    seed: Annotated[int, typer.Option(help="Seed from which random values are drawn.")] = 0,
    platform: Annotated[
        str, typer.Option(help="Platforms, comma-separated: host, linux64, win64, darwin64, …")
    ] = "host",
) -> None:
    """Write a system as SSP that other tools can simulate: FMUs, values and units inside."""
    version = fmi_version(fmi)
    platforms = platform_names(platform)
    if out.suffix.lower() != ".ssp":
        raise InputInvalid(out, f"ending {out.suffix!r} was read", ".ssp")
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.running.library import load
    from uuvsim_cosim.orchestrator.ssp.ssp import pack

    found = load(system)
    with console(stderr=True).status(f"packing {system}"):
        pack(found, out, fmi=version, seed=seed, platforms=platforms)
    plan = flatten(found)
    for group in plan.groups:
        if group.algorithm != "jacobi":
            members = ", ".join(plan.components[i].path for i in group.members)
            remark(
                "warning",
                f"{group.algorithm} group {members}: SSP has no groups, so other tools delay its "
                "connections by a step; `uuvsim fmu container` keeps it",
            )
    file_line(out)
