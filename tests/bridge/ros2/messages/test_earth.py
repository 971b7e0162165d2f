"""Places on Earth of positions in NED."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.bridge.ros2.messages.earth import geodetic, geodetic_of_grid
from uuvsim_cosim.commands.shared.waypoints import local_of


@given(st.floats(-85, 85), st.floats(-180, 180), st.floats(-2e4, 2e4), st.floats(-2e4, 2e4))
def test_the_place_leads_back_to_the_position(
    latitude: float, longitude: float, north: float, east: float
) -> None:
    tangent = np.array([[north, east, 0.0]])
    lat, lon, height = geodetic(tangent, latitude, longitude)[0]
    # `local_of` takes places of height 0; the point below has a horizontal offset of d h / R.
    back = local_of((float(lat), float(lon)), (latitude, longitude))
    d = np.hypot(north, east)
    assert np.hypot(back[0] - north, back[1] - east) < 1e-6 + 1.01 * d * height / 6.33e6
    assert height == pytest.approx(d * d / (2 * 6.37e6), rel=0.02, abs=1e-6)


def test_one_degree_of_latitude_at_the_equator_is_110_574_m() -> None:
    arc = 6378137.0 * (1 - 6.69437999014e-3)  # radius of curvature in the meridian
    lat, lon, height = geodetic(np.array([[arc * np.radians(0.01), 0.0, 3.0]]), 0.0, 10.0)[0]
    assert (lat, lon) == pytest.approx((0.01, 10.0), abs=1e-8)
    assert height == pytest.approx(-3.0, abs=0.1)


def test_below_the_origin_is_the_origins_place_at_a_negative_height() -> None:
    assert geodetic(np.array([[0.0, 0.0, 12.5]]), 47.3, -122.5)[0] == pytest.approx(
        [47.3, -122.5, -12.5]
    )


def test_the_middle_of_a_utm_zone_has_its_central_meridian() -> None:
    lat, lon, height = geodetic_of_grid(np.array([[100.0, -20.0, 7.0]]), 32610, -100.0, 500020.0)[0]
    assert (lat, lon, height) == (pytest.approx(0.0, abs=1e-9), pytest.approx(-123.0), -7.0)
