"""`uuvsim new`: write a template of a component that fits its slot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import components, of, systems
from uuvsim_cosim.commands.shared.options import folder_option
from uuvsim_cosim.commands.shared.terminal import file_line, line, tilde

__all__ = ["new_command"]


def new_command(
    component: Annotated[
        str, typer.Argument(autocompletion=components, help="The component to take the place of.")
    ],
    kind: Annotated[
        str,
        typer.Option(
            "--as", autocompletion=of("python", "pythonfmu3", "c"), help="python, pythonfmu3 or c."
        ),
    ] = "python",
    system: Annotated[
        str, typer.Option("--for", autocompletion=systems, help="The system that has the slot.")
    ] = "bluerov2_survey",
    out: Annotated[Path, folder_option("Folder to write into.")] = Path(),
) -> None:
    """Write a starting point for a component of your own, and say how to run it."""
    from uuvsim_cosim.orchestrator.running.library import load
    from uuvsim_cosim.orchestrator.shipped.scaffold import class_name, write_scaffold

    slot = load(system).slot(component)
    written = write_scaffold(slot, kind, out)
    for path in written:
        file_line(path, tilde(path))
    first = written[0]
    source, before = f"{tilde(first)}:{class_name(slot)}", ""
    if kind == "pythonfmu3":
        source, before = f"{class_name(slot)}.fmu", f"pythonfmu3 build -f {tilde(first)}"
    elif kind == "c":
        source = tilde(first.with_suffix(".fmu"))
        before = f"python {tilde(first.with_name('build.py'))}"
    line()
    if before:
        line(f"build it with  {before}")
    line(f"run it with    uuvsim run {system} --replace {component}={source}")
