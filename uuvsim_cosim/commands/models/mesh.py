"""`uuvsim models mesh`: write the mesh of a vehicle as glTF, and compare it with its numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import models
from uuvsim_cosim.commands.shared.terminal import file_line, number, remark, table, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["mesh_command"]


def mesh_command(
    vehicle: Annotated[
        str, typer.Argument(autocompletion=models, help="Vehicle as id, id@set or folder.")
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write, .glb; by default ID.glb.")
    ] = None,
) -> None:
    """Write the mesh of a vehicle as glTF and compare its volume and extent with its parameters."""
    from uuvsim_cosim.models.declaration.parameter_files import vehicle_folder, vehicle_size
    from uuvsim_cosim.models.shapes.hull_shape import hull_shape
    from uuvsim_cosim.models.vehicles.mesh_figures import displaced_volume

    shape = hull_shape(vehicle)
    if shape is None:
        raise InputInvalid(
            vehicle_folder(vehicle),
            "there is no shape.yaml, so the vehicle has no mesh",
            "one with its parts (docs/vehicles/shapes.md)",
        )
    file = Path(f"{shape.vehicle}.glb") if out is None else out
    if file.suffix != ".glb":
        raise InputInvalid(file, "another type of file", "a name that ends with .glb")
    displaced, rho, stated = displaced_volume(vehicle)
    low, high = shape.extent
    size = vehicle_size(vehicle)
    rows = [("volume [L]", number(1e3 * shape.volume, ".2f"), number(1e3 * displaced, ".2f"))]
    sizes = (None,) * 3 if size is None else (size.length, size.breadth, size.height)
    for name, found, given in zip(("length", "breadth", "height"), high - low, sizes, strict=True):
        own = "" if given is None else number(given, ".4g")
        rows.append((f"{name} [m]", number(float(found), ".4g"), own))  # type: ignore[arg-type]
    rows.append(("triangles", number(len(shape.surface[1]), ".0f"), ""))  # type: ignore[arg-type]
    table(("", "mesh", "parameters"), rows, key="mesh")
    if not stated:
        remark("assumed", f"rho = {rho:g} kg/m3, which the set does not state")
    if shape.invented:
        remark("note", f"no source states the form of {', '.join(shape.invented)}")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(shape.glb())
    file_line(file, tilde(file))
