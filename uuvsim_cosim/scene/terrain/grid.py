"""Positions of a terrain's nodes in a projection, and polygons rasterised onto them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.chart.projection import Projection
from uuvsim_cosim.scene.shared.extra import import_extra

if TYPE_CHECKING:
    from rasterio import Affine
    from shapely import Geometry

    from uuvsim_cosim.scene.chart.read import Shapes

__all__ = [
    "MOST_NODES",
    "Bounds",
    "Grid",
    "Piece",
    "TooManyNodes",
    "cropped_terrain",
    "grid_over",
    "piece_of",
]

Bounds = tuple[float, float, float, float]


@dataclass(frozen=True)
class Piece:
    """A rectangle along N and E around a place."""

    latitude: float  # degrees
    longitude: float  # degrees
    north: float  # m, its extent along N
    east: float  # m

    def within(self, projection: Projection, bounds: Bounds) -> Bounds:
        """Return the part inside `bounds`: west, south, east, north (m); InputInvalid if empty."""
        ((x, y),) = projection.forward(np.array([[self.longitude, self.latitude]]))
        west, south, east, north = bounds
        cut = (
            max(west, x - self.east / 2),
            max(south, y - self.north / 2),
            min(east, x + self.east / 2),
            min(north, y + self.north / 2),
        )
        if not (cut[0] < cut[2] and cut[1] < cut[3]):
            corners = projection.inverse(np.array([[west, south], [east, north]]))
            (lon_1, lat_1), (lon_2, lat_2) = corners
            raise InputInvalid(
                f"--around {self.latitude:g},{self.longitude:g} lies outside what is charted: "
                f"latitude {lat_1:.4f} to {lat_2:.4f}, longitude {lon_1:.4f} to {lon_2:.4f}"
            )
        return cut


def piece_of(around: str | None, size: str | None) -> Piece | None:
    """Read `LAT,LON` and `KM` or `KMxKM` (N x E); None without either."""
    if around is None and size is None:
        return None
    if around is None or size is None:
        raise InputInvalid("--around LAT,LON and --size KM (or KMxKM, N x E) are wanted together")
    try:
        latitude, longitude = (float(v) for v in around.split(","))
        if not (abs(latitude) <= 90 and abs(longitude) <= 360):
            raise ValueError
    except ValueError:
        raise InputInvalid(
            f"--around {around}", "LAT,LON in degrees, such as 47.27,-122.52"
        ) from None
    try:
        parts = [1e3 * float(v) for v in size.lower().split("x")]
        north, east = parts * 2 if len(parts) == 1 else parts
        if not (north > 0 and east > 0 and np.isfinite([north, east]).all()):
            raise ValueError
    except ValueError:
        raise InputInvalid(f"--size {size}", "km as 3 or, N x E, 3x5") from None
    return Piece(latitude, longitude, north, east)


def cropped_terrain(
    z: NDArray[np.floating],
    sigma: NDArray[np.floating] | None,
    material: NDArray[np.uint8] | None,
    materials: tuple[str, ...],
    grid: Grid,
    crs: str,
    vertical_datum: str,
    source: str,
) -> Terrain:
    """Make the terrain of a grid without its unknown margins; its middle is the origin."""
    known = np.isfinite(z)
    rows, columns = np.nonzero(known.any(axis=1))[0], np.nonzero(known.any(axis=0))[0]
    if not len(rows):
        raise InputInvalid("not one node of the terrain has a depth")
    r = _at_least_two(int(rows[0]), int(rows[-1]), z.shape[0])
    c = _at_least_two(int(columns[0]), int(columns[-1]), z.shape[1])
    h = grid.spacing
    middle_row, middle_column = (r.stop - r.start) // 2, (c.stop - c.start) // 2
    return Terrain(
        z=np.ascontiguousarray(z[r, c], np.float32),
        spacing=h,
        origin=(-middle_row * h, -middle_column * h),
        sigma=None if sigma is None else np.ascontiguousarray(sigma[r, c], np.float32),
        crs=crs,
        northing=grid.south + (r.start + middle_row) * h,
        easting=grid.west + (c.start + middle_column) * h,
        vertical_datum=vertical_datum,
        material=None if material is None else np.ascontiguousarray(material[r, c]),
        materials=materials,
        source=source,
    )


def _at_least_two(first: int, last: int, size: int) -> slice:
    last = max(last, min(first + 1, size - 1))
    return slice(min(first, last - 1), last + 1)


Floats = NDArray[np.float64]

MOST_NODES = 25_000_000  # 100 MB a layer; a chart needs about ten while it is made


class TooManyNodes(InputInvalid):
    """A grid with more nodes than are held in memory; `fits` is the spacing (m) that would do."""

    def __init__(self, message: str, fits: float) -> None:
        super().__init__(message)
        self.fits = fits


@dataclass(frozen=True)
class Grid:
    """Nodes at E = west + j * spacing, N = south + i * spacing, in m of a projection."""

    west: float
    south: float
    spacing: float
    rows: int
    columns: int

    @property
    def shape(self) -> tuple[int, int]:
        """Number of nodes along N and E."""
        return self.rows, self.columns

    @property
    def east(self) -> Floats:
        """E of each column."""
        return self.west + self.spacing * np.arange(self.columns, dtype=np.float64)

    @property
    def north(self) -> Floats:
        """N of each row."""
        return self.south + self.spacing * np.arange(self.rows, dtype=np.float64)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north of the outermost nodes."""
        return (
            self.west,
            self.south,
            self.west + self.spacing * (self.columns - 1),
            self.south + self.spacing * (self.rows - 1),
        )

    @property
    def transform(self) -> Affine:
        """The affine from (column, row from the north) of pixels centred on the nodes to E, N."""
        affine = import_extra("rasterio", "gridding a chart").Affine
        h = self.spacing
        north = self.south + h * (self.rows - 1)
        return affine(h, 0, self.west - h / 2, 0, -h, north + h / 2)

    def burn(
        self,
        shapes: Sequence[Geometry] | Shapes,
        numbers: Iterable[int] | None = None,
        *,
        touched: bool = False,
    ) -> NDArray[np.int32]:
        """Return for each node the number of the last shape that holds it, -1 for none; int32.

        By default, shapes are numbered from 0.
        """
        if not len(shapes):
            return np.full(self.shape, -1, np.int32)
        if numbers is None:
            numbers = range(len(shapes))
        features = import_extra("rasterio.features", "gridding a chart")
        burnt: NDArray[np.int32] = features.rasterize(
            [(shape, int(n)) for shape, n in zip(shapes, numbers, strict=True)],
            out_shape=self.shape,
            transform=self.transform,
            fill=-1,
            all_touched=touched,
            dtype="int32",
        )
        return burnt[::-1]  # GDAL counts rows from the north, a grid from the south

    def nearest(
        self, points: Floats
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Return the (row, column) nearest to each point (E, N), and which points are inside."""
        column = np.rint((points[:, 0] - self.west) / self.spacing).astype(np.int64)
        row = np.rint((points[:, 1] - self.south) / self.spacing).astype(np.int64)
        inside = (row >= 0) & (row < self.rows) & (column >= 0) & (column < self.columns)
        return row, column, inside


def grid_over(
    bounds: tuple[float, float, float, float],
    spacing: float,
    most: int = MOST_NODES,
    first: tuple[float, float] | None = None,
) -> Grid:
    """Cover west, south, east, north (m) with nodes at whole multiples of the spacing.

    If `first` (E, N) is given, the nodes lie at whole multiples of the spacing from there.
    """
    if not (np.isfinite(spacing) and spacing > 0):
        raise InputInvalid(f"resolution {spacing:g} m", "more than 0")
    x, y = first or (0.0, 0.0)
    west, south, east, north = bounds[0] - x, bounds[1] - y, bounds[2] - x, bounds[3] - y
    near = 1e-6 if first else 1e-9  # of a spacing, by which bounds may miss a node
    corner = floor(west / spacing + near), floor(south / spacing + near)
    columns = ceil(east / spacing - near) - corner[0] + 1
    rows = ceil(north / spacing - near) - corner[1] + 1
    if rows * columns > most:
        coarse = spacing * (rows * columns / most) ** 0.5
        step = 10 ** floor(np.log10(coarse))
        fits = ceil(coarse / step * 1.02) * step
        raise TooManyNodes(
            f"{(east - west) / 1e3:.4g} x {(north - south) / 1e3:.4g} km at {spacing:g} m are "
            f"{rows * columns:,} nodes, more than the {most:,} that are made at once; "
            f"--resolution {fits:g} fits, or a piece by --around LAT,LON --size KM, or, of a "
            "chart, -o FILE.tif, which is written in tiles",
            fits,
        )
    return Grid(
        x + corner[0] * spacing, y + corner[1] * spacing, spacing, max(rows, 2), max(columns, 2)
    )
