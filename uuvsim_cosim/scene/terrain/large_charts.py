"""GeoTIFF of a chart with more nodes than fit into memory, written tile by tile."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.chart.read import read_chart
from uuvsim_cosim.scene.shared.extra import wanted
from uuvsim_cosim.scene.terrain.chart import chart_grid, source_of
from uuvsim_cosim.scene.terrain.grid import MOST_NODES, Grid
from uuvsim_cosim.scene.terrain.piece import Piece
from uuvsim_cosim.scene.terrain.surface import prepared, surface_on
from uuvsim_cosim.scene.terrain.write import check_whole

__all__ = ["Large", "write_large"]

_MOST = 4_000_000_000  # nodes; 32 GB before compression
_TILE = 3072  # nodes along a side; a multiple of the file's blocks


@dataclass(frozen=True)
class Large:
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
) -> Large | None:
    """Write a chart's GeoTIFF in tiles; return None without writing for `above` nodes or fewer.

    The file equals that of the terrain as a whole, plus a margin without data where the chart has
    none. Raises `InputInvalid`.
    """
    chart = read_chart(file)
    grid = chart_grid(chart, resolution, piece, _MOST)
    if grid.rows * grid.columns <= above:
        return None
    rasterio = wanted("rasterio", "writing a GeoTIFF")
    of = prepared(chart, resolution, land)
    # Nodes around a tile that are interpolated with it, so that its nearest data are among them.
    far = of.hold_out.distances
    reach = 2 * float(np.quantile(far, 0.95)) if len(far) else 50 * resolution
    margin = int(np.clip(ceil(reach / resolution), 8, 512))
    held = charted = 0
    with whole_file(target) as scratch:
        with rasterio.open(
            scratch, "w", driver="GTiff", height=grid.rows, width=grid.columns, count=2,
            dtype="float32", crs=chart.projection.code, nodata=np.nan, transform=grid.transform,
            compress="deflate", predictor=3, tiled=True, blockxsize=256, blockysize=256,
            bigtiff="if_safer",
        ) as out:  # fmt: skip
            for row in range(0, grid.rows, tile):
                for column in range(0, grid.columns, tile):
                    rows, columns = min(tile, grid.rows - row), min(tile, grid.columns - column)
                    # tiles count rows from the north, nodes from the south
                    south = grid.rows - row - rows
                    around = _cut(grid, south, column, rows, columns, margin)
                    found = surface_on(of, around)
                    inner = np.s_[margin : margin + rows, margin : margin + columns]
                    window = rasterio.windows.Window(column, row, columns, rows)
                    out.write(np.float32(-found.z[inner][::-1] + 0.0), 1, window=window)
                    out.write(np.float32(found.sigma[inner][::-1]), 2, window=window)
                    held += int(found.held[inner].sum())
                    charted += int(found.charted[inner].sum())
            for number, name in enumerate(("elevation", "sigma"), 1):
                out.set_band_description(number, name)
                out.set_band_unit(number, "m")
            out.update_tags(
                AREA_OR_POINT="Point",
                VERTICAL_DATUM=chart.vertical_datum or "not stated",
                SOURCE=source_of(chart, None),
                NOTE="elevation = -depth; not for navigation",
            )
        if not charted:
            raise InputInvalid(f"{file}: no water within this piece of the chart")
        check_whole(scratch)
    cell = chart.files.identification
    facts = {
        "chart": f"{cell.name}, edition {cell.edition} of {cell.issued}, 1:{chart.scale:,}",
        "updates": f"stands at update {chart.files.last_update}",
        "grid": f"{grid.rows:,} x {grid.columns:,} nodes at {resolution:g} m, "
        f"{chart.projection.code}, in tiles of {tile:,}",
        "datum": chart.vertical_datum or "not stated",
        "in charted band": f"{100 * held / charted:.1f} % of nodes before clipping",
        "soundings left out": f"median error {of.hold_out.median:.2f} m, mean "
        f"{of.hold_out.mean:.2f} m ({len(of.hold_out.errors)} one by one)",
    }
    return Large(facts, of.notes)


def _cut(grid: Grid, south: int, west: int, rows: int, columns: int, margin: int) -> Grid:
    h = grid.spacing
    return Grid(
        grid.west + (west - margin) * h,
        grid.south + (south - margin) * h,
        h,
        rows + 2 * margin,
        columns + 2 * margin,
    )
