"""`uuvsim terrain`: make a terrain or a scene from a nautical chart or a surveyed grid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.terminal import file_line, line, remark, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["terrain_command"]


def terrain_command(
    chart: Annotated[
        Path,
        typer.Argument(
            help="Chart or grid: S-57 cell (.000), BAG, GeoTIFF, S-102, a terrain or a scene."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write (.tif, .png, .glb, .sdf or .npz), or folder of a scene.",
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(
            "--resolution",
            "-r",
            help="Distance between nodes in m; default: 10 for a chart, the cell size for a grid.",
        ),
    ] = None,
    around: Annotated[
        str | None, typer.Option("--around", help="Centre of the area to use: LAT,LON in degrees.")
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            "--size", help="Size of the area of --around in km: 3, or north x east such as 3x5."
        ),
    ] = None,
    land: Annotated[
        str | None,
        typer.Option("--land", help="Height of land in m above the datum, or unknown."),
    ] = None,
    relief: Annotated[
        int | None,
        typer.Option(
            "--relief", help="Seed of random relief finer than the spacing of the soundings."
        ),
    ] = None,
    datum: Annotated[
        str | None,
        typer.Option("--datum", help="Vertical datum that the depths must have, such as MLLW."),
    ] = None,
    unit: Annotated[
        str | None, typer.Option("--unit", help="Unit of a grid that does not state it: m, ft.")
    ] = None,
    positive: Annotated[
        str | None,
        typer.Option("--positive", help="Direction in which a grid's values increase: up or down."),
    ] = None,
    fill: Annotated[
        float,
        typer.Option("--fill", help="Fill a grid's holes up to this distance from data, in m."),
    ] = 0.0,
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs", help="Coordinate reference system of a grid without one: EPSG:32632."
        ),
    ] = None,
    local: Annotated[
        bool,
        typer.Option(
            "--local",
            help="Read a grid without a reference system in a local frame: x east, y north, in m.",
        ),
    ] = False,
) -> None:
    """Make a terrain from a chart (and update files beside it) or a grid; without -o, show it.

    Not for navigation.
    """
    from uuvsim_cosim.models.worlds.scene import Scene
    from uuvsim_cosim.scene.terrain.grid import TooManyNodes
    from uuvsim_cosim.scene.terrain.make import TerrainOptions, make_large, make_terrain
    from uuvsim_cosim.scene.terrain.write import check_target, write_terrain

    if not fill >= 0:
        raise InputInvalid(f"--fill {fill:g}", "0 m or more")
    if relief is not None and relief < 0:
        raise InputInvalid(f"--relief {relief}", "a seed of 0 or more")
    if out is not None:
        check_target(out)
    options = TerrainOptions(
        resolution,
        around,
        size,
        land,
        relief,
        datum,
        unit,
        positive,
        fill,
        crs,
        local,
    )
    try:
        made = make_terrain(chart, options)
    except OSError as error:
        raise InputInvalid(f"{chart}: cannot be read: {error.strerror or error}") from None
    except TooManyNodes as many:
        try:
            large = make_large(chart, out, options) if out is not None else None
        except OSError as error:
            raise InputInvalid(f"{out}: cannot be written: {error.strerror or error}") from None
        if large is not None and out is not None:
            table(("", ""), large.facts.items(), key="facts")
            for note in large.notes:
                remark("note", note)
            file_line(out, f"wrote {out}")
            return
        if resolution is not None:
            raise
        line(
            f"note: nodes are {many.fits:g} m apart, because the default resolution has too many "
            "nodes "
            "(for a chart, -o FILE.tif writes all of them)"
        )
        made = make_terrain(chart, replace(options, resolution=many.fits))
    table(("", ""), made.facts.items(), key="facts")
    for note in made.notes:
        remark("note", note)
    if out is None:
        return
    sizes = "; sizes of obstacles are assumed" if made.obstacles else ""
    scene = Scene(
        out.stem,
        made.terrain,
        made.obstacles,
        description=f"Seabed of {chart.stem} at {made.terrain.spacing:g} m",
        source=(made.terrain.source or f"{chart.name}") + sizes,
        meshes=made.meshes,
    )
    try:
        files = write_terrain(scene, out)
    except OSError as error:
        raise InputInvalid(f"{out}: cannot be written: {error.strerror or error}") from None
    for file in files:
        file_line(file, f"wrote {file}")
    if (made.obstacles or made.meshes) and out.suffix in (".tif", ".tiff", ".png", ".npz"):
        what = " or ".join(
            name for name, some in (("obstacles", made.obstacles), ("meshes", made.meshes)) if some
        )
        remark("note", f"{out.suffix} holds no {what}; a scene's folder, .sdf and .glb do")
