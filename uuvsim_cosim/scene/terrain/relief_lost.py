"""Relief of a surveyed grid that is lost in a terrain with other nodes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.scene.shared.extra import import_extra
from uuvsim_cosim.scene.terrain.grid import Grid

if TYPE_CHECKING:
    from rasterio import Affine, DatasetReader
    from rasterio.crs import CRS
    from rasterio.windows import Window

__all__ = ["LostRelief", "place", "relief_lost"]

Floats = NDArray[np.float64]
Number = TypeVar("Number", float, Floats)

_WINDOW = 1024  # cells along a side
_MOST = 40_000_000  # cells; of a larger grid, evenly spaced windows are compared


@dataclass(frozen=True, eq=False)
class LostRelief:
    """Difference between a grid's cells and the terrain's triangles at their centres."""

    rms: float  # m
    share: float  # of the variance of the grid's cells
    sigma: Floats  # m, RMS of the cells around each node, shaped as the grid
    compared: float  # share of the cells that are compared


def relief_lost(
    source: DatasetReader,
    crs: CRS,
    code: str,
    grid: Grid,
    z: NDArray[np.floating],
    metres: tuple[float, float],
) -> LostRelief | None:
    """Compare band 1 of an open rasterio dataset in `crs` with the terrain made of it.

    `z` (rows, columns) holds the terrain's elevations [m] at the nodes of `grid` in the projection
    `code`; `metres` is the factor and the offset from the band's numbers to m. None if no cell
    lies among known nodes.
    """
    windows = _windows(source, crs, code, grid)
    cells = sum(w.width * w.height for w in windows)
    compared_in = windows[:: max(1, -(-cells // _MOST))]
    to = None
    if crs.to_string() != code:
        pyproj = import_extra("pyproj", "placing a grid on Earth")
        to = pyproj.Transformer.from_crs(crs, code, always_xy=True)
    squares, counts = np.zeros(grid.rows * grid.columns), np.zeros(grid.rows * grid.columns)
    total = squared = 0.0
    for window in compared_in:
        known = source.read(1, window=window, masked=True)
        row, column = np.nonzero(~np.ma.getmaskarray(known) & np.isfinite(known.data))
        if not len(row):
            continue
        value = known.data[row, column].astype(np.float64) * metres[0] + metres[1]
        x, y = place(source.transform, column + window.col_off + 0.5, row + window.row_off + 0.5)
        if to is not None:
            x, y = to.transform(x, y)
        error = value - _on_triangles(grid, z, x, y)
        compared = np.isfinite(error)
        i, j, _ = grid.nearest(np.column_stack([x, y])[compared])
        flat = i * grid.columns + j
        squares += np.bincount(flat, error[compared] ** 2, len(squares))
        counts += np.bincount(flat, minlength=len(counts))
        total += float(value[compared].sum())
        squared += float((value[compared] ** 2).sum())
    n = float(counts.sum())
    if not n:
        return None
    mean = float(squares.sum()) / n
    variance = squared / n - (total / n) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        local = np.where(counts > 0, squares / counts, mean)
    return LostRelief(
        rms=mean**0.5,
        share=mean / variance if variance > 0 else 0.0,
        sigma=np.sqrt(local).reshape(grid.shape),
        compared=sum(w.width * w.height for w in compared_in) / cells,
    )


def place(affine: Affine, column: Number, row: Number) -> tuple[Number, Number]:
    """Return x and y of a column and row, which count from the corner of the first cell."""
    a, b, c, d, e, f = affine[:6]
    return a * column + b * row + c, d * column + e * row + f


def _windows(source: DatasetReader, crs: CRS, code: str, grid: Grid) -> list[Window]:
    """Return the windows of the source that may hold cells within the grid."""
    import_extra("rasterio.warp", "reading a grid")
    rasterio = import_extra("rasterio", "reading a grid")
    west, south, east, north = grid.bounds
    if crs.to_string() != code:
        there = rasterio.warp.transform_bounds(code, crs, west, south, east, north)
        west, south, east, north = there
    back = ~source.transform
    corners = [(x, y) for x in (west, east) for y in (south, north)]
    columns, rows = zip(*(place(back, x, y) for x, y in corners), strict=True)
    first = max(0, int(min(rows)) - 1), max(0, int(min(columns)) - 1)
    last = min(source.height, int(max(rows)) + 2), min(source.width, int(max(columns)) + 2)
    return [
        rasterio.windows.Window(
            column, row, min(_WINDOW, last[1] - column), min(_WINDOW, last[0] - row)
        )
        for row in range(first[0], last[0], _WINDOW)
        for column in range(first[1], last[1], _WINDOW)
    ]


def _on_triangles(grid: Grid, z: NDArray[np.floating], x: Floats, y: Floats) -> Floats:
    """Interpolate as rays meet the terrain: two triangles a cell; NaN outside and unknown."""
    fi, fj = (y - grid.south) / grid.spacing, (x - grid.west) / grid.spacing
    inside = (np.abs(fi - (grid.rows - 1) / 2) < (grid.rows - 1) / 2 + 1e-9) & (
        np.abs(fj - (grid.columns - 1) / 2) < (grid.columns - 1) / 2 + 1e-9
    )
    i = np.clip(fi.astype(np.int64), 0, grid.rows - 2)
    j = np.clip(fj.astype(np.int64), 0, grid.columns - 2)
    f, g = fi - i, fj - j
    a, b, c, d = z[i, j], z[i + 1, j], z[i, j + 1], z[i + 1, j + 1]
    found = np.where(f >= g, a + f * (b - a) + g * (d - b), a + g * (c - a) + f * (d - c))
    return np.where(inside, found, np.nan)
