import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine
from scipy.ndimage import map_coordinates

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.terrain.grid import piece_of
from uuvsim_cosim.scene.terrain.make import TerrainOptions, make_terrain
from uuvsim_cosim.scene.terrain.raster import raster_terrain

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


def rough(rows: int = 40, columns: int = 60) -> np.ndarray:
    return np.random.default_rng(5).normal(-30, 4, (rows, columns)).astype(np.float32)


@pytest.mark.parametrize("resolution", [None, CELL])
def test_the_nodes_of_a_grid_are_the_centres_of_its_cells(
    tmp_path: Path, resolution: float | None
) -> None:
    values = rough()
    made = raster_terrain(grid(tmp_path / "a.tif", values), resolution)
    t = made.terrain
    np.testing.assert_array_equal(t.z, -values[::-1])
    assert t.spacing == CELL
    assert t.easting + t.origin[1] == WEST + CELL / 2
    assert t.northing + t.origin[0] == NORTH - 39.5 * CELL
    assert t.sigma is None
    assert not any("resampled" in n for n in made.notes)


def test_a_piece_has_the_nodes_of_the_whole_grid(tmp_path: Path) -> None:
    from pyproj import Transformer

    values = rough()
    to_degrees = Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    lon, lat = to_degrees.transform(WEST + 151, NORTH - 101)
    file = grid(tmp_path / "a.tif", values)
    t = raster_terrain(file, None, piece_of(f"{lat:.9f},{lon:.9f}", "0.05")).terrain
    row = round((NORTH - CELL / 2 - (t.northing + t.origin[0])) / CELL)
    column = round((t.easting + t.origin[1] - WEST - CELL / 2) / CELL)
    n, m = t.z.shape
    np.testing.assert_array_equal(t.z, -values[row - n + 1 : row + 1, column : column + m][::-1])


@pytest.mark.parametrize("resolution", [2 * CELL, 1.7 * CELL, 0.6 * CELL])
def test_relief_between_the_nodes_is_reported_and_included_in_sigma(
    tmp_path: Path, resolution: float
) -> None:
    values = np.stack([rough(), np.full((40, 60), 0.5)])
    file = grid(tmp_path / "a.tif", values, names=("elevation", "uncertainty"))
    made = raster_terrain(file, resolution)
    (note,) = [n for n in made.notes if n.startswith("resampled")]
    lost = float(re.findall(r"relief of ([\d.]+) m RMS", note)[0])
    t = made.terrain
    # The same by scipy, on the terrain's bilinear surface, which differs a little from triangles.
    i = (NORTH - CELL * (np.arange(40) + 0.5) - t.northing - t.origin[0]) / resolution
    j = (WEST + CELL * (np.arange(60) + 0.5) - t.easting - t.origin[1]) / resolution
    at = np.stack(np.meshgrid(i, j, indexing="ij"))
    error = values[0] + map_coordinates(t.z, at, order=1, cval=np.nan)
    assert lost == pytest.approx(np.sqrt(np.nanmean(error**2)), rel=0.15)
    assert lost > 0.5
    assert t.sigma is not None
    assert np.sqrt(np.nanmean(t.sigma**2)) == pytest.approx(np.hypot(lost, 0.5), rel=0.1)


def test_a_plane_loses_nothing_between_other_nodes(tmp_path: Path) -> None:
    made = raster_terrain(grid(tmp_path / "a.tif"), 7.0)
    (note,) = [n for n in made.notes if n.startswith("resampled")]
    assert float(re.findall(r"relief of ([\d.e-]+) m RMS", note)[0]) < 0.1


def test_cells_in_degrees_keep_about_their_spacing_and_the_loss_is_reported(tmp_path: Path) -> None:
    degrees = Affine(1e-4, 0, 9.0, 0, -1e-4, 47.8)
    made = raster_terrain(grid(tmp_path / "a.tif", rough(), crs="EPSG:4326", transform=degrees))
    assert made.terrain.spacing == pytest.approx(7.48, abs=0.1)  # 1e-4 degrees of longitude
    assert any(n.startswith("resampled to nodes at 7.") for n in made.notes)
    assert made.terrain.sigma is not None


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_a_grid_without_a_reference_system_is_taken_with_crs_or_local(tmp_path: Path) -> None:
    values = rough()
    file = grid(tmp_path / "a.tif", values, crs=None)
    with pytest.raises(InputInvalid, match=r"no coordinate reference system.*--crs EPSG.*--local"):
        make_terrain(file, TerrainOptions())
    t = make_terrain(file, TerrainOptions(crs="EPSG:32632")).terrain
    np.testing.assert_array_equal(t.z, -values[::-1])
    assert (t.crs, t.easting + t.origin[1]) == ("EPSG:32632", WEST + CELL / 2)
    pool = grid(tmp_path / "b.tif", values, crs=None, transform=Affine(0.5, 0, -4, 0, -0.5, 10))
    t = make_terrain(pool, TerrainOptions(local=True)).terrain
    np.testing.assert_array_equal(t.z, -values[::-1])
    assert (t.crs, t.northing, t.easting) == ("", 0.0, 0.0)
    assert t.origin == pytest.approx((10 - 39.5 * 0.5, -3.75))
    bare = make_terrain(grid(tmp_path / "c.tif", values, crs=None, transform=Affine.identity()),
                        TerrainOptions(local=True))  # fmt: skip
    assert any("the file has no positions" in n for n in bare.notes)


@pytest.mark.parametrize(
    ("wishes", "said"),
    [
        (TerrainOptions(crs="EPSG:32632", local=True), "expected one of the two"),
        (TerrainOptions(crs="EPSG:25832"), "the file states EPSG:32632"),
        (TerrainOptions(crs="UTM 32"), "expected a code such as EPSG:32632"),
        (TerrainOptions(local=True), "--local: the file states EPSG:32632"),
        (TerrainOptions(resolution=0.0), "resolution 0 m; expected more than 0"),
        (TerrainOptions(resolution=float("nan")), "resolution nan m"),
    ],
)
def test_a_wrong_reference_or_resolution_is_refused(
    tmp_path: Path, wishes: TerrainOptions, said: str
) -> None:
    with pytest.raises(InputInvalid, match=said):
        make_terrain(grid(tmp_path / "a.tif"), wishes)


@pytest.mark.parametrize("wishes", [TerrainOptions(crs="EPSG:32632"), TerrainOptions(local=True)])
def test_a_scene_takes_no_other_place(wishes: TerrainOptions) -> None:
    with pytest.raises(InputInvalid, match="not for a scene, which tacoma is"):
        make_terrain(Path("tacoma"), wishes)


@pytest.mark.parametrize("resolution", [None, 7.0])
@pytest.mark.parametrize("unit", ["m", "ft"])
def test_scale_and_offset_of_stored_numbers_are_applied_and_reported(
    tmp_path: Path, resolution: float | None, unit: str
) -> None:
    values = np.round(rough(), 2)
    want = raster_terrain(grid(tmp_path / "a.tif", values, unit=unit), resolution)
    stored = np.round((values + 50.0) / 0.01)
    file = grid(tmp_path / "b.tif", stored, unit=unit)
    with rasterio.open(file, "r+") as out:
        out.scales, out.offsets = (0.01,), (-50.0,)
    got = raster_terrain(file, resolution)
    np.testing.assert_allclose(got.terrain.z, want.terrain.z, atol=1e-4)
    if resolution is not None:  # the relief that is lost is compared in metres, too
        assert got.terrain.sigma is not None
        np.testing.assert_allclose(got.terrain.sigma, want.terrain.sigma, atol=1e-3)
    said = "band 1 states a scale and an offset, which are applied: value = 0.01 x stored number"
    assert any(said in note for note in got.notes)


def test_stored_integers_with_a_scale_keep_missing_values_missing(tmp_path: Path) -> None:
    stored = np.full((20, 20), -1250, np.int16)
    stored[5, 5] = -32768
    where = Affine(CELL, 0, WEST, 0, -CELL, NORTH)
    with rasterio.open(
        tmp_path / "a.tif", "w", driver="GTiff", width=20, height=20, count=1, dtype="int16",
        crs="EPSG:32632", transform=where, nodata=-32768,
    ) as out:  # fmt: skip
        out.write(stored, 1)
        out.scales = (0.01,)
    z = raster_terrain(tmp_path / "a.tif").terrain.z
    assert np.isnan(z).sum() == 1
    np.testing.assert_allclose(z[np.isfinite(z)], 12.5, rtol=1e-6)


@pytest.mark.parametrize("scale", [0.0, float("nan"), float("inf")])
def test_a_scale_that_is_none_is_refused(tmp_path: Path, scale: float) -> None:
    file = grid(tmp_path / "a.tif")
    with rasterio.open(file, "r+") as out:
        out.scales = (scale,)
    with pytest.raises(InputInvalid, match=r"band 1 has the scale .* finite and not 0"):
        raster_terrain(file)


@pytest.mark.parametrize(
    ("vertical", "value", "metres"),
    [
        ("6360", -100.0, 100 * 1200 / 3937),  # NAVD88 height (ftUS)
        ("6358", 100.0, 100 * 1200 / 3937),  # NAVD88 depth (ftUS)
        ("5715", 100.0, 100.0),  # MSL depth
        ("8228", -100.0, 100 * 0.3048),  # NAVD88 height (ft)
    ],
)
def test_the_vertical_axis_gives_unit_and_direction(
    tmp_path: Path, vertical: str, value: float, metres: float
) -> None:
    file = grid(tmp_path / "a.tif", np.full((20, 20), value), unit="", crs=f"EPSG:32632+{vertical}")
    made = raster_terrain(file)
    np.testing.assert_allclose(made.terrain.z, metres, rtol=1e-6)
    assert any("axis of the file points down" in n for n in made.notes) == (value > 0)


def test_feet_become_metres_and_it_is_said(tmp_path: Path) -> None:
    made = raster_terrain(grid(tmp_path / "a.tif", np.full((20, 20), -100.0), unit="ft"), 10.0)
    np.testing.assert_allclose(made.terrain.z, 30.48, atol=1e-4)
    assert any("values are in ft: converted" in n for n in made.notes)
    silent = grid(tmp_path / "b.tif", np.full((20, 20), -100.0), unit="")
    assert any("does not state its unit" in n for n in raster_terrain(silent, 10.0).notes)
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
    t = make_terrain(file, TerrainOptions(resolution=5.0)).terrain
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
        make_terrain(path, TerrainOptions())


def test_depths_from_another_datum_are_refused_and_a_silent_grid_believed(tmp_path: Path) -> None:
    said = grid(tmp_path / "a.tif", tags={"VERTICAL_DATUM": "LAT"})
    with pytest.raises(InputInvalid, match="from LAT, not from MSL"):
        make_terrain(said, TerrainOptions(datum="MSL"))
    silent = make_terrain(grid(tmp_path / "b.tif"), TerrainOptions(datum="MSL"))
    assert silent.terrain.vertical_datum == "MSL"
