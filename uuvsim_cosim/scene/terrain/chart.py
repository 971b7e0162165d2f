"""Terrain of a chart: triangulated, clipped into the charted depth areas, with its sigma."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from math import ceil
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Obstacle
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.chart.read import Chart, read_chart
from uuvsim_cosim.scene.shared.extra import import_extra
from uuvsim_cosim.scene.terrain.grid import MOST_NODES, Grid, Piece, cropped_terrain, grid_over
from uuvsim_cosim.scene.terrain.material import materials_of
from uuvsim_cosim.scene.terrain.obstacles import obstacles_of
from uuvsim_cosim.scene.terrain.surface import prepared, surface_on
from uuvsim_cosim.scene.terrain.tin import HoldOut
from uuvsim_cosim.scene.terrain.write import elevation_geotiff

__all__ = ["DescribedTerrain", "TiledTerrain", "chart_terrain", "write_large"]

_MOST = 4_000_000_000  # nodes; 32 GB before compression
_TILE = 3072  # nodes along a side; a multiple of the file's blocks


@dataclass(frozen=True, eq=False)
class DescribedTerrain:
    """A terrain with its obstacles, facts and notes."""

    terrain: Terrain
    obstacles: tuple[Obstacle, ...]
    facts: dict[str, str]  # shown to the user, in order
    notes: tuple[str, ...] = ()
    hold_out: HoldOut | None = None
    in_band: float = float("nan")  # share of interpolated nodes within their band before clipping
    meshes: tuple[PlacedMesh, ...] = ()  # of a scene


def chart_terrain(
    file: Path,
    resolution: float = 10.0,
    piece: Piece | None = None,
    land: float | None = None,
    relief: int | None = None,
) -> DescribedTerrain:
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
    material, names = materials_of(chart, grid, found.land, np.isnan(z))
    source = source_of(chart, relief)
    terrain = cropped_terrain(z, sigma, material, names, grid, chart.projection.code,
                     chart.vertical_datum, source)  # fmt: skip
    obstacles, left_out = obstacles_of(chart, terrain)
    notes += left_out
    updates = ", ".join(p.name for p in chart.files.updates) or "none beside it"
    water = terrain.z[np.isfinite(terrain.sigma if terrain.sigma is not None else terrain.z)]
    held_out = of.hold_out
    facts = {
        "chart": _edition(chart),
        "updates": f"{updates}; the chart is at update {chart.files.last_update}",
        "known": f"{len(chart.soundings):,} soundings, {len(chart.contours):,} contours",
        "datum": chart.vertical_datum or "not stated",
        "grid": f"{terrain.z.shape[0]} x {terrain.z.shape[1]} nodes at {terrain.spacing:g} m, "
        f"{terrain.crs}, origin N {terrain.northing:g} E {terrain.easting:g}",
        "depth": f"{water.min():.1f} to {water.max():.1f} m",
        "land": "unknown"
        if np.isnan(of.height)
        else f"{of.height:g} m above the datum, flat: assumed",
        "in charted band": f"{100 * in_band:.1f} % of nodes before clipping",
        "soundings left out": f"{held_out}, {100 * held_out.within_two_sigma:.0f} % within 2 sigma"
        if len(held_out.errors)
        else "no soundings",
        "seabed's nature": ", ".join(terrain.materials) or "not charted",
        "obstacles": str(len(obstacles)),
    }
    return DescribedTerrain(terrain, obstacles, facts, tuple(notes), of.hold_out, in_band)


def chart_grid(
    chart: Chart, resolution: float, piece: Piece | None, most: int = MOST_NODES
) -> Grid:
    """Return the grid over a chart's depth areas, or a piece of it."""
    shapely = import_extra("shapely", "gridding a chart")
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


@dataclass(frozen=True)
class TiledTerrain:
    """Facts and notes on a chart that was written in tiles."""

    facts: dict[str, str]
    notes: tuple[str, ...]


def write_large(
    file: Path,
    target: Path,
    resolution: float,
    piece: Piece | None,
    land: float | None,
    tile: int = _TILE,
    above: int = MOST_NODES,
) -> TiledTerrain | None:
    """Write a chart's GeoTIFF in tiles; return None without writing for `above` nodes or fewer.

    The file equals that of the terrain as a whole, plus a margin without data where the chart has
    none. Raises `InputInvalid`.
    """
    chart = read_chart(file)
    grid = chart_grid(chart, resolution, piece, _MOST)
    if grid.rows * grid.columns <= above:
        return None
    rasterio = import_extra("rasterio", "writing a GeoTIFF")
    of = prepared(chart, resolution, land)
    # Nodes around a tile that are interpolated with it, so that its nearest data are among them.
    far = of.hold_out.distances
    reach = 2 * float(np.quantile(far, 0.95)) if len(far) else 50 * resolution
    margin = int(np.clip(ceil(reach / resolution), 8, 512))
    held = charted = 0
    with whole_file(target) as scratch:
        with elevation_geotiff(
            scratch, grid.shape, grid.transform, chart.projection.code, ("elevation", "sigma"),
            VERTICAL_DATUM=chart.vertical_datum or "not stated", SOURCE=source_of(chart, None),
            NOTE="elevation = -depth; not for navigation",
        ) as out:  # fmt: skip
            for row, column in product(range(0, grid.rows, tile), range(0, grid.columns, tile)):
                rows, columns = min(tile, grid.rows - row), min(tile, grid.columns - column)
                h, south = grid.spacing, grid.rows - row - rows  # nodes count from the south
                around = Grid(
                    grid.west + (column - margin) * h, grid.south + (south - margin) * h, h,
                    rows + 2 * margin, columns + 2 * margin,
                )  # fmt: skip
                found = surface_on(of, around)
                inner = np.s_[margin : margin + rows, margin : margin + columns]
                window = rasterio.windows.Window(column, row, columns, rows)
                out.write(np.float32(-found.z[inner][::-1] + 0.0), 1, window=window)
                out.write(np.float32(found.sigma[inner][::-1]), 2, window=window)
                held += int(found.held[inner].sum())
                charted += int(found.charted[inner].sum())
        if not charted:
            raise InputInvalid(f"{file}: no water within this piece of the chart")
    facts = {
        "chart": _edition(chart),
        "updates": f"the chart is at update {chart.files.last_update}",
        "grid": f"{grid.rows:,} x {grid.columns:,} nodes at {resolution:g} m, "
        f"{chart.projection.code}, in tiles of {tile:,}",
        "datum": chart.vertical_datum or "not stated",
        "in charted band": f"{100 * held / charted:.1f} % of nodes before clipping",
        "soundings left out": str(of.hold_out),
    }
    return TiledTerrain(facts, of.notes)


def _edition(chart: Chart) -> str:
    cell = chart.files.identification
    return f"{cell.name}, edition {cell.edition} of {cell.issued}, 1:{chart.scale:,}"
