"""Places on Earth (WGS 84) of positions in the local frame `n`, NED."""

from __future__ import annotations

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array

__all__ = ["geodetic", "geodetic_of_grid"]

_A, _E2 = 6378137.0, 6.69437999014e-3  # WGS 84: semi-major axis [m], first eccentricity squared


def geodetic(ned: Array, latitude: float, longitude: float) -> Array:
    """Return latitude, longitude [deg] and height [m] (n, 3) of places (n, 3) in NED.

    North and east are those of the plane that touches WGS 84 at the origin, which has height 0
    (EPSG Guidance Note 7-2, method 9837). Latitude is found by Bowring's formula (1976), whose
    error is below 1e-11 deg at heights within 20 km.
    """
    phi, lam = np.radians([latitude, longitude])
    (sp, cp), (sl, cl) = (np.sin(phi), np.cos(phi)), (np.sin(lam), np.cos(lam))
    n, e, d = ned.T
    radius = _A / np.sqrt(1 - _E2 * sp**2)
    across = radius * cp - sp * n - cp * d
    x, y = cl * across - sl * e, sl * across + cl * e
    z = radius * (1 - _E2) * sp + cp * n - sp * d
    b = _A * np.sqrt(1 - _E2)
    p = np.hypot(x, y)
    theta = np.arctan2(z * _A, p * b)
    north = np.arctan2(
        z + _E2 / (1 - _E2) * b * np.sin(theta) ** 3, p - _E2 * _A * np.cos(theta) ** 3
    )
    height = p * np.cos(north) + z * np.sin(north) - _A * np.sqrt(1 - _E2 * np.sin(north) ** 2)
    return np.stack([np.degrees(north), np.degrees(np.arctan2(y, x)), height], axis=1)


def geodetic_of_grid(ned: Array, code: int, northing: float, easting: float) -> Array:
    """Return latitude, longitude [deg] and height [m] (n, 3) of places (n, 3) along a map grid.

    `n` has its origin at northing and easting [m] of the projected system EPSG:`code`, and its
    north and east are those of the grid. Needs the extra ``scene``.
    """
    from uuvsim_cosim.scene.chart.projection import projection_of

    metres = np.column_stack([easting + ned[:, 1], northing + ned[:, 0]])
    degrees = projection_of(f"EPSG:{code}").inverse(metres)
    return np.column_stack([degrees[:, 1], degrees[:, 0], -ned[:, 2]])
