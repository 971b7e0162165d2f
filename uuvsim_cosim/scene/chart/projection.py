"""Projection of a chart from degrees to metres: the UTM zone (or polar grid) at its middle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.scene.shared.extra import import_extra

if TYPE_CHECKING:
    from pyproj import Transformer

__all__ = ["Projection", "projection_at", "projection_of", "utm_code"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Projection:
    """A projected CRS, and its transformation from longitude and latitude (WGS 84)."""

    code: str  # "EPSG:32610"
    to_metres: Transformer

    def forward(self, degrees: Floats) -> Floats:
        """Return E, N (m) of longitudes and latitudes; (n, 2)."""
        east, north = self.to_metres.transform(degrees[:, 0], degrees[:, 1])
        return np.column_stack([east, north])

    def inverse(self, metres: Floats) -> Floats:
        """Return longitudes and latitudes (degrees) of E, N (m); (n, 2)."""
        longitude, latitude = self.to_metres.transform(
            metres[:, 0], metres[:, 1], direction="INVERSE"
        )
        return np.column_stack([longitude, latitude])


def projection_at(degrees: Floats) -> Projection:
    """Choose the projection at the middle of these longitudes and latitudes; (n, 2).

    A chart that spans more than half the Earth is assumed to cross the anti-meridian.
    """
    longitude = degrees[:, 0]
    if np.ptp(longitude) > 180:
        longitude = np.where(longitude < 0, longitude + 360, longitude)
    middle = 0.5 * (longitude.min() + longitude.max())
    height = 0.5 * (degrees[:, 1].min() + degrees[:, 1].max())
    return projection_of(utm_code((middle + 180) % 360 - 180, height))


def projection_of(code: str) -> Projection:
    """Return the projection of a code such as EPSG:32610."""
    pyproj = import_extra("pyproj", "placing a chart on Earth")
    return Projection(code, pyproj.Transformer.from_crs("EPSG:4326", code, always_xy=True))


def utm_code(longitude: float, latitude: float) -> str:
    """Return the EPSG code of the UTM zone at a place (degrees); beyond 84 N and 80 S of UPS."""
    if latitude > 84:
        return "EPSG:5041"
    if latitude < -80:
        return "EPSG:5042"
    zone = int((longitude + 180) // 6) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"
