from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.terrain_make import Wishes, make_terrain
from uuvsim_cosim.scene.terrain_piece import piece_of
from uuvsim_cosim.scene.terrain_raster import raster_terrain

WEST, NORTH, CELL = 500_000.0, 5_300_000.0, 5.0


def grid(
    path: Path, values: Any = None, *, unit: str = "m", tags: dict[str, str] | None = None,
    crs: str | None = "EPSG:32632", transform: Affine | None = None, names: tuple[str, ...] = (),
    driver: str = "GTiff", **profile: Any,
) -> Path:  # fmt: skip
    """Write elevations; by default a plane that falls by 0.1 m per metre to the east."""
    if values is None:
        x = CELL * (np.arange(60) + 0.5)
        values = np.tile(-10 - 0.1 * x, (40, 1))
    bands = np.atleast_3d(np.asarray(values, np.float32).T).T
    where = transform or Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    with rasterio.open(
        path, "w", driver=driver, width=bands.shape[2], height=bands.shape[1], count=len(bands),
        dtype="float32", crs=crs, transform=where, **profile,
    ) as out:  # fmt: skip
        out.write(bands)
        for k, name in enumerate(names, 1):
            out.set_band_description(k, name)
        if unit:
            out.set_band_unit(1, unit)
        out.update_tags(**(tags or {}))
    return path


def test_a_plane_of_elevations_becomes_the_plane_of_depths(tmp_path: Path) -> None:
    t = raster_terrain(grid(tmp_path / "a.tif", tags={"VERTICAL_DATUM": "LAT"}), 10.0).terrain
    east = t.easting + t.origin[1] + 10.0 * np.arange(t.z.shape[1])
    inner = np.s_[1:-1, 1:-1]
    expected = np.broadcast_to(10 + 0.1 * (east - WEST), t.z.shape)
    np.testing.assert_allclose(t.z[inner], expected[inner], atol=0.26)  # half a cell's fall
    assert (t.crs, t.vertical_datum) == ("EPSG:32632", "LAT")


def test_feet_become_metres_and_it_is_said(tmp_path: Path) -> None:
    made = raster_terrain(grid(tmp_path / "a.tif", np.full((20, 20), -100.0), unit="ft"), 10.0)
    np.testing.assert_allclose(made.terrain.z, 30.48, atol=1e-4)
    assert any("values are in ft: converted" in n for n in made.notes)
    silent = grid(tmp_path / "b.tif", np.full((20, 20), -100.0), unit="")
    assert any("does not say its unit" in n for n in raster_terrain(silent, 10.0).notes)
    np.testing.assert_allclose(raster_terrain(silent, 10.0, unit="ft").terrain.z, 30.48, atol=1e-4)


def test_the_uncertainty_band_becomes_sigma(tmp_path: Path) -> None:
    values = np.stack([np.full((20, 20), -8.0), np.full((20, 20), 0.25)])
    t = raster_terrain(grid(tmp_path / "a.tif", values, names=("elevation", "uncertainty")), 5.0)
    assert t.terrain.sigma is not None
    np.testing.assert_allclose(t.terrain.sigma, 0.25)


def test_holes_are_counted_and_bridged_only_when_asked(tmp_path: Path) -> None:
    values = np.full((40, 40), -12.0)
    values[15:20, 15:20] = -9999
    file = grid(tmp_path / "a.tif", values, nodata=-9999)
    holed = raster_terrain(file, 5.0)
    assert np.isnan(holed.terrain.z).sum() >= 16
    assert any("lie in holes without data" in n for n in holed.notes)
    filled = raster_terrain(file, 5.0, fill=50.0)
    np.testing.assert_allclose(filled.terrain.z, 12.0, atol=1e-4)
    assert any("bridged: assumed" in n for n in filled.notes)
    assert filled.terrain.sigma is not None
    assert filled.terrain.sigma.max() > 0


def test_a_bag_is_read_with_its_uncertainty(tmp_path: Path) -> None:
    values = np.stack([np.full((30, 30), -51.5), np.full((30, 30), 0.3)])
    file = grid(tmp_path / "a.bag", values, driver="BAG", unit="", nodata=1e6)
    made = raster_terrain(file, 10.0)
    np.testing.assert_allclose(made.terrain.z, 51.5)
    assert made.terrain.sigma is not None
    np.testing.assert_allclose(made.terrain.sigma, 0.3)


def test_an_s102_coverage_is_read_with_its_datum_and_grows_down(tmp_path: Path) -> None:
    import netCDF4

    file = tmp_path / "102XX00TEST.h5"
    pair = np.dtype([("depth", "f4"), ("uncertainty", "f4")])
    with netCDF4.Dataset(file, "w", format="NETCDF4") as root:
        root.setncatts({
            "productSpecification": "INT.IHO.S-102.2.2", "horizontalCRS": np.int32(32632),
            "verticalDatum": np.int32(12), "issueDate": "20260101",
        })  # fmt: skip
        coverage = root.createGroup("BathymetryCoverage")
        one = coverage.createGroup("BathymetryCoverage.01")
        one.setncatts({
            "gridOriginLongitude": WEST, "gridOriginLatitude": NORTH, "startSequence": "0,0",
            "gridSpacingLongitudinal": 5.0, "gridSpacingLatitudinal": 5.0,
            "numPointsLongitudinal": np.int32(30), "numPointsLatitudinal": np.int32(20),
        })  # fmt: skip
        group = one.createGroup("Group_001")
        kind = group.createCompoundType(pair, "pair")
        group.createDimension("y", 20)
        group.createDimension("x", 30)
        values = np.zeros((20, 30), pair)
        values["depth"] = 20 + np.arange(20)[:, None]
        values["uncertainty"] = 0.4
        group.createVariable("values", kind, ("y", "x"))[:] = values
        root.createGroup("Group_F")
    t = make_terrain(file, Wishes(resolution=5.0)).terrain
    np.testing.assert_allclose(t.z, np.broadcast_to(20 + np.arange(20)[:, None], (20, 30)))
    assert t.vertical_datum == "MLLW"
    assert t.sigma is not None
    np.testing.assert_allclose(t.sigma, 0.4)


def test_degrees_and_mercator_are_brought_into_a_utm_zone(tmp_path: Path) -> None:
    values = np.full((50, 50), -7.0)
    degrees = Affine(1e-4, 0, 9.0, 0, -1e-4, 47.8)
    assert raster_terrain(
        grid(tmp_path / "a.tif", values, crs="EPSG:4326", transform=degrees), 20.0
    ).terrain.crs == "EPSG:32632"  # fmt: skip
    web = Affine(10, 0, 1_000_000, 0, -10, 6_000_000)
    t = raster_terrain(grid(tmp_path / "b.tif", values, crs="EPSG:3857", transform=web), 20.0)
    assert t.terrain.crs in {"EPSG:32631", "EPSG:32632"}
    width = t.terrain.extent[3] - t.terrain.extent[2]
    assert 300 < width < 400  # 490 m of Mercator at 47 N


def test_depths_that_grow_downwards_are_refused_or_taken(tmp_path: Path) -> None:
    file = grid(tmp_path / "a.tif", np.full((20, 20), 25.0))
    with pytest.raises(InputInvalid, match=r"lie above the datum.*--positive down"):
        raster_terrain(file, 10.0)
    np.testing.assert_allclose(raster_terrain(file, 10.0, positive="down").terrain.z, 25.0)
    named = grid(tmp_path / "b.tif", np.full((20, 20), 25.0), names=("depth",))
    np.testing.assert_allclose(raster_terrain(named, 10.0).terrain.z, 25.0)


def test_a_file_larger_than_what_is_held_is_read_in_pieces(tmp_path: Path) -> None:
    file = tmp_path / "big.tif"
    with rasterio.open(
        file, "w", driver="GTiff", width=60_000, height=60_000, count=1, dtype="float32",
        crs="EPSG:32632", transform=Affine(1, 0, WEST, 0, -1, NORTH), sparse_ok=True,
        tiled=True, nodata=-9999,
    ) as out:  # fmt: skip
        out.write(np.full((512, 512), -33, np.float32), 1,
                  window=rasterio.windows.Window(51_200, 10_240, 512, 512))  # fmt: skip
    with pytest.raises(InputInvalid, match=r"more than the 25,000,000.*--resolution"):
        raster_terrain(file, 1.0)
    from pyproj import Transformer

    to_degrees = Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(WEST + 51_456, NORTH - 10_496)
    t = raster_terrain(file, 2.0, piece_of(f"{lat:.7f},{lon:.7f}", "0.4")).terrain
    np.testing.assert_allclose(t.z, -33 * -1.0)


@pytest.mark.parametrize(
    ("file", "said"),
    [
        (lambda p: grid(p, crs=None), "no coordinate reference system"),
        (lambda p: grid(p, unit="furlong"), "values in 'furlong'"),
        (lambda p: grid(p, np.full((9, 9), 1e6)), "not of this Earth"),
        (lambda p: grid(p, np.full((9, 9), np.nan)), "not one cell has a value"),
        (lambda p: p.write_bytes(b"II*\0 nothing") and p, "neither an S-57 chart nor a grid"),
        (lambda p: p.write_text("a,b\n1,2\n") and p, "neither an S-57 chart nor a grid"),
    ],
)
@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_a_grid_that_is_none_is_refused_in_words(tmp_path: Path, file: Any, said: str) -> None:
    path = tmp_path / "a.tif"
    file(path)
    with pytest.raises(InputInvalid, match=said):
        make_terrain(path, Wishes())


def test_depths_from_another_datum_are_refused_and_a_silent_grid_believed(tmp_path: Path) -> None:
    said = grid(tmp_path / "a.tif", tags={"VERTICAL_DATUM": "LAT"})
    with pytest.raises(InputInvalid, match="from LAT, not from MSL"):
        make_terrain(said, Wishes(datum="MSL"))
    silent = make_terrain(grid(tmp_path / "b.tif"), Wishes(datum="MSL"))
    assert silent.terrain.vertical_datum == "MSL"
