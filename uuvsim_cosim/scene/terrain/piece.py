"""Rectangular piece of a charted area, and the terrain in its local frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.chart.projection import Projection
from uuvsim_cosim.scene.terrain.grid import Grid

__all__ = ["Piece", "piece_of", "shrunk"]

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


def shrunk(
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
