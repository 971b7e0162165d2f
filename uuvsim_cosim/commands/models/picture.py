"""`uuvsim models picture`: draw vehicles with their thrusters and fins at their places."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import models
from uuvsim_cosim.commands.shared.terminal import file_line, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["picture_command"]


def picture_command(
    vehicles: Annotated[
        list[str] | None,
        typer.Argument(
            autocompletion=models,
            help="Vehicles as id or folder, one panel each; by default all shipped vehicles.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="SVG file to write.")] = Path(
        "vehicles.svg"
    ),
) -> None:
    """Draw vehicles in three dimensions: hull, thrusters and fins as their files state them."""
    from uuvsim_cosim.view.scene3d.vehicle_figure import vehicle_figure

    if out.suffix != ".svg":
        raise InputInvalid(out, "another type of file", "a name that ends with .svg")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(vehicle_figure(vehicles or ()), encoding="utf-8")
    file_line(out, tilde(out))
