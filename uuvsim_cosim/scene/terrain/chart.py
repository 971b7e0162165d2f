"""Terrain of a chart: triangulated, clipped into the charted depth areas, with its sigma."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Obstacle
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.chart.read import Chart, read_chart
from uuvsim_cosim.scene.shared.extra import wanted
from uuvsim_cosim.scene.terrain.grid import MOST_NODES, Grid, grid_over
from uuvsim_cosim.scene.terrain.piece import Piece, shrunk
from uuvsim_cosim.scene.terrain.surface import prepared, surface_on
from uuvsim_cosim.scene.terrain.tin import HoldOut

__all__ = ["Made", "chart_grid", "chart_terrain", "source_of"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Made:
    """A terrain with its obstacles, facts and notes."""

    terrain: Terrain
    obstacles: tuple[Obstacle, ...]
    facts: dict[str, str]  # shown to the user, in order
    notes: tuple[str, ...] = ()
    hold_out: HoldOut | None = None
    in_band: float = float("nan")  # share of interpolated nodes within their band before clipping
    figures: dict[str, float] = field(default_factory=dict)
    meshes: tuple[PlacedMesh, ...] = ()  # of a scene


def chart_terrain(
    file: Path,
    resolution: float = 10.0,
    piece: Piece | None = None,
    land: float | None = None,
    relief: int | None = None,
) -> Made:
    """Make a terrain of an S-57 cell and its updates.

    `land` is the height of land above the datum (m; NaN leaves it unknown), by default that of the
    highest drying area, at least 2 m. `relief` seeds an invented relief below the soundings'
    spacing. Raises `InputInvalid` if the file is no chart, or has no seabed.
    """
    chart = read_chart(file)
    grid = chart_grid(chart, resolution, piece)
    of = prepared(chart, resolution, land)
    found = surface_on(of, grid, relief)
    z, sigma = found.z, found.sigma
    if not np.isfinite(z[~found.land]).any():
        raise InputInvalid(f"{file}: no water within this piece of the chart")
    notes = [*of.notes, *([found.relief] if found.relief else [])]
    in_band = found.held.sum() / found.charted.sum() if found.charted.any() else float("nan")
    from uuvsim_cosim.scene.terrain.material import materials_of

    material, names = materials_of(chart, grid, found.land, np.isnan(z))
    source = source_of(chart, relief)
    terrain = shrunk(z, sigma, material, names, grid, chart.projection.code,
                     chart.vertical_datum, source)  # fmt: skip
    from uuvsim_cosim.scene.terrain.obstacles import obstacles_of

    obstacles, said_of = obstacles_of(chart, terrain)
    notes += said_of
    facts = _facts(chart, terrain, of.hold_out, in_band, of.height, len(obstacles))
    figures = {"soundings": float(len(chart.soundings)), "points": float(len(of.mesh.points.xy))}
    return Made(terrain, obstacles, facts, tuple(notes), of.hold_out, in_band, figures)


def chart_grid(
    chart: Chart, resolution: float, piece: Piece | None, most: int = MOST_NODES
) -> Grid:
    """Return the grid over a chart's depth areas, or a piece of it."""
    shapely = wanted("shapely", "gridding a chart")
    whole = shapely.total_bounds(chart.depth_areas.shapes)
    bounds = tuple(float(v) for v in whole)
    if piece is not None:
        bounds = piece.within(chart.projection, bounds)  # type: ignore[arg-type]
    return grid_over(bounds, resolution, most)  # type: ignore[arg-type]


def source_of(chart: Chart, relief: int | None) -> str:
    """Return the source of a terrain as text."""
    cell = chart.files.identification
    producer = "NOAA ENC " if cell.name.startswith("US") else "ENC "
    text = (
        f"{producer}{Path(cell.name).stem}, edition {cell.edition}, update "
        f"{chart.files.last_update}, {cell.issued}, 1:{chart.scale:,}; not for navigation"
    )
    if relief is not None:
        text += f"; relief below the soundings' spacing is invented (seed {relief})"
    return text


def _facts(
    chart: Chart, terrain: Terrain, hold_out: HoldOut, in_band: float, land: float, obstacles: int
) -> dict[str, str]:
    cell = chart.files.identification
    updates = ", ".join(p.name for p in chart.files.updates) or "none beside it"
    water = terrain.z[np.isfinite(terrain.sigma if terrain.sigma is not None else terrain.z)]
    return {
        "chart": f"{cell.name}, edition {cell.edition} of {cell.issued}, 1:{chart.scale:,}",
        "updates": f"{updates}; stands at update {chart.files.last_update}",
        "known": f"{len(chart.soundings):,} soundings, {len(chart.contours):,} contours",
        "datum": chart.vertical_datum or "not stated",
        "grid": f"{terrain.z.shape[0]} x {terrain.z.shape[1]} nodes at {terrain.spacing:g} m, "
        f"{terrain.crs}, origin N {terrain.northing:g} E {terrain.easting:g}",
        "depth": f"{water.min():.1f} to {water.max():.1f} m",
        "land": "unknown" if np.isnan(land) else f"{land:g} m above the datum, flat: assumed",
        "in charted band": f"{100 * in_band:.1f} % of nodes before clipping",
        "soundings left out": f"median error {hold_out.median:.2f} m, mean {hold_out.mean:.2f} m "
        f"({len(hold_out.errors)} one by one), "
        f"{100 * hold_out.within_two_sigma:.0f} % within 2 sigma"
        if len(hold_out.errors)
        else "no soundings",
        "seabed's nature": ", ".join(terrain.materials) or "not charted",
        "obstacles": str(obstacles),
    }
