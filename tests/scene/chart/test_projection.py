"""Where a chart lies on Earth: the zone of its UTM projection, or UPS beyond."""

from __future__ import annotations

import pytest

from uuvsim_cosim.scene.chart.projection import utm_code


@pytest.mark.parametrize(
    ("longitude", "latitude", "code"),
    [
        (10.4, 63.4, "EPSG:32632"), (-122.4, 47.3, "EPSG:32610"), (151.2, -33.9, "EPSG:32756"),
        (-180.0, 0.0, "EPSG:32601"), (179.9, -0.1, "EPSG:32760"), (180.0, 10.0, "EPSG:32601"),
        (0.0, 84.0, "EPSG:32631"), (0.0, 84.5, "EPSG:5041"),
        (0.0, -80.0, "EPSG:32731"), (0.0, -80.5, "EPSG:5042"),
    ],
)  # fmt: skip
def test_a_place_has_the_zone_of_its_longitude(
    longitude: float, latitude: float, code: str
) -> None:
    assert utm_code(longitude, latitude) == code
