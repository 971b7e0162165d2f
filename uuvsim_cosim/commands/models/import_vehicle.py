"""`uuvsim models import`: make a vehicle from a surface and a mass, or a robot's description."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.options import folder_option
from uuvsim_cosim.commands.shared.terminal import file_line, line, number, remark, table, tilde
from uuvsim_cosim.errors import InputInvalid

__all__ = ["import_command"]

_DESCRIPTIONS = (".urdf", ".sdf", ".xacro", ".xml", ".world")


def import_command(
    file: Annotated[
        Path, typer.Argument(help="A closed surface (.stl), or a .urdf, .sdf or .xacro.")
    ],
    mass: Annotated[
        float | None, typer.Option("--mass", help="Mass in kg; needed for a surface.")
    ] = None,
    scale: Annotated[
        float | None, typer.Option("--scale", help="Metres per unit of the file; 0.001 for mm.")
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(
            "--axes", help="Directions of x, y and z in the file: FLU (default), FRD, RFU or LBU."
        ),
    ] = None,
    volume: Annotated[
        float | None,
        typer.Option("--volume", help="Displaced volume in m3, if the hull floods."),
    ] = None,
    z_g: Annotated[
        float | None,
        typer.Option(
            "--z-g", help="Distance in m of the centre of gravity below the centre of buoyancy."
        ),
    ] = None,
    rho: Annotated[
        float | None, typer.Option("--rho", help="Density of the water in kg/m3; default 1025.")
    ] = None,
    added_mass: Annotated[
        str | None,
        typer.Option(
            "--added-mass",
            help="How to find a surface's added mass: capytaine (default if installed), ellipsoid, "
            "or a folder imported from the same surface.",
        ),
    ] = None,
    turn_inside_out: Annotated[
        bool,
        typer.Option("--turn-inside-out", help="Turn triangles whose normals point inwards."),
    ] = False,
    out: Annotated[Path | None, folder_option("Folder to write; its name is the id.")] = None,
) -> None:
    """Estimate a vehicle from its surface and mass, or read it from a robot's description.

    Writes the folder of a vehicle. Each number has its unit and source; estimates are marked.
    """
    from uuvsim_cosim.models.importing.vehicle_draft import check_id, write_draft

    if not file.is_file():
        raise InputInvalid(file, "no such file", "a surface (.stl), .urdf, .sdf or .xacro")
    if out is None:
        id = re.sub(r"[^a-z0-9_]+", "_", file.name.split(".")[0].lower()).strip("_")
        folder = Path(id if id[:1].isalpha() else f"vehicle_{id}")
    else:
        folder = out
    check_id(folder.name)
    if file.suffix.lower() in _DESCRIPTIONS:
        options = {"--mass": mass, "--volume": volume, "--z-g": z_g, "--scale": scale,
                   "--axes": axes, "--rho": rho, "--added-mass": added_mass,
                   "--turn-inside-out": turn_inside_out or None}  # fmt: skip
        for name, given in options.items():
            if given is not None:
                raise InputInvalid(f"{name}: applies to a surface; {file.name} has its own value")
        from uuvsim_cosim.models.importing.import_description import import_description

        found = import_description(file)
        draft, notes = found.draft, found.notes
    else:
        if mass is None:
            raise InputInvalid(file, "a surface has no mass", "--mass and kg")
        from uuvsim_cosim.models.importing.import_mesh import import_mesh

        surface = import_mesh(
            file,
            mass,
            scale=1.0 if scale is None else scale,
            axes=axes or "FLU",
            rho=1025.0 if rho is None else rho,
            volume=volume,
            z_g=z_g,
            added_mass=added_mass or "auto",
            turn=turn_inside_out,
        )
        solid = surface.solid
        line(f"{file.name}: a closed surface of {solid.surface:.4g} m2")
        names = ("length", "breadth", "height")
        table(
            ("axis", "extent [m]", "area seen [m2]", "C_D", "from", "to"),
            [
                (
                    f"{a} ({n})",
                    number(solid.extent[i], ".4g"),
                    number(solid.areas[i], ".4g"),
                    *(number(surface.C_D[k, i], ".3g") for k in (1, 0, 2)),
                )
                for i, (a, n) in enumerate(zip("xyz", names, strict=True))
            ],
            key="extents",
        )
        where = ", ".join(f"{v:.4g}" for v in surface.origin)
        line(
            f"volume {solid.volume:.5g} m3; CO is its centre, "
            f"the file's origin is at ({where}) m (FRD)"
        )
        line()
        draft, notes = surface.draft, surface.notes
    written = write_draft(draft, folder)
    table(
        ("number", "value", "unit", "source"),
        [(n, number(q.value, ".5g"), q.unit, q.source) for n, q in draft.quantities.items()],
        key="numbers",
    )
    for note in notes:
        remark("note", note)
    line()
    for path in sorted(written.iterdir()):
        file_line(path, tilde(path))
    line()
    line(f"check it with  uuvsim models check {tilde(written)}")
    line(f"use it as      model:{tilde(written)}")
