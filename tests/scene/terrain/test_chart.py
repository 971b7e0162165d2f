from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.scene.s57_cell import Cell, rectangle, slope
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Sphere
from uuvsim_cosim.scene.chart.read import read_chart
from uuvsim_cosim.scene.terrain.chart import DescribedTerrain, chart_terrain
from uuvsim_cosim.scene.terrain.grid import piece_of

WEST, SOUTH, SIZE = 10.0, 54.0, 0.02
SHORE = WEST + 0.1 * SIZE
EAST = WEST + SIZE


def depth_at(longitude: np.ndarray) -> np.ndarray:
    """The plane that `slope` charts."""
    return 40 * (longitude - SHORE) / (EAST - SHORE)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> DescribedTerrain:
    cell = slope()
    cell.point("WRECKS", (10.01, 54.01), VALSOU=5.5, OBJNAM="Erna")
    cell.point("BOYLAT", (10.012, 54.012))
    cell.point("PILPNT", (10.004, 54.004))
    cell.point("UWTROC", (10.014, 54.004), WATLEV=3)
    cell.line("PIPSOL", [(10.006, 54.006), (10.008, 54.006)])
    cell.area("PONTON", rectangle(10.012, 54.01, 10.0125, 54.0103))
    cell.point("OBSTRN", (10.011, 54.005), CATOBS=7)
    cell.point("LNDARE", (10.015, 54.015))
    cell.point("SBDARE", (10.01, 54.01), NATSUR="4,1")
    return chart_terrain(cell.write(tmp_path_factory.mktemp("chart") / "XX5SLOPE.000"))


def _degrees(made: DescribedTerrain) -> tuple[np.ndarray, np.ndarray]:
    from pyproj import Transformer

    t = made.terrain
    n = t.northing + t.origin[0] + t.spacing * np.arange(t.z.shape[0])
    e = t.easting + t.origin[1] + t.spacing * np.arange(t.z.shape[1])
    east, north = np.meshgrid(e, n)
    back = Transformer.from_crs(t.crs, "EPSG:4326", always_xy=True)
    longitude, latitude = back.transform(east, north)
    return longitude, latitude


def test_a_charted_plane_comes_back_as_the_plane(made: DescribedTerrain) -> None:
    longitude, latitude = _degrees(made)
    inside = (longitude > SHORE + 0.0002) & (longitude < EAST - 0.001)
    inside &= (latitude > SOUTH + 0.001) & (latitude < SOUTH + SIZE - 0.001)
    inside &= np.hypot(longitude - 10.015, latitude - 54.015) > 0.0005  # the islet
    error = made.terrain.z[inside] - depth_at(longitude[inside])
    assert np.abs(error).max() < 0.1  # m; soundings are rounded to 0.1 m
    assert made.terrain.crs == "EPSG:32632"
    assert made.terrain.vertical_datum == "MLLW"
    assert made.in_band > 0.995


def test_every_node_lies_in_its_charted_band(tmp_path: Path) -> None:
    cell = Cell()
    bands = [(3.6, 5.4), (5.4, 9.1), (9.1, 20.7)]
    for k, (low, high) in enumerate(bands):
        ring = rectangle(10 + 0.005 * k, 54, 10.005 + 0.005 * k, 54.01)
        cell.area("DEPARE", ring, DRVAL1=low, DRVAL2=high)
    rng = np.random.default_rng(0)  # soundings that belong to other bands
    cell.soundings([(10 + 0.015 * u, 54 + 0.01 * v, 30 * w) for u, v, w in rng.random((60, 3))])
    made = chart_terrain(cell.write(tmp_path / "A.000"))
    longitude, latitude = _degrees(made)
    for k, (low, high) in enumerate(bands):
        inside = (longitude > 10 + 0.005 * k + 1e-5) & (longitude < 10.005 + 0.005 * k - 1e-5)
        inside &= (latitude > 54 + 1e-5) & (latitude < 54.01 - 1e-5)
        assert made.terrain.z[inside].min() >= np.float32(low)
        assert made.terrain.z[inside].max() <= np.float32(high)
    assert made.in_band < 0.9


def test_a_sounding_against_its_charted_area_is_clipped_and_doubted_and_said(
    tmp_path: Path,
) -> None:
    cell = Cell()
    cell.area("DEPARE", rectangle(10, 54, 10.02, 54.01), DRVAL1=5.4, DRVAL2=9.1)
    places = [(10 + 0.002 * i, 54 + 0.002 * j) for i in range(1, 10) for j in range(1, 5)]
    cell.soundings([(x, y, 25.1 if (x, y) == places[17] else 7.0) for x, y in places])
    made = chart_terrain(cell.write(tmp_path / "A.000"))
    assert made.terrain.sigma is not None
    assert np.nanmax(made.terrain.z) <= np.float32(9.1)
    assert 14 < np.nanmax(made.terrain.sigma) < 17  # beside the charted 25.1 m
    assert any("1 soundings lie outside" in n and "16.0 m" in n for n in made.notes)


def test_land_stands_above_the_datum_and_is_not_measured(made: DescribedTerrain) -> None:
    longitude, latitude = _degrees(made)
    t = made.terrain
    assert t.sigma is not None
    land = (longitude < SHORE - 0.0002) & (longitude > WEST + 0.0002)
    land &= (latitude > SOUTH + 0.0002) & (latitude < SOUTH + SIZE - 0.0002)
    assert (t.z[land] == -2.0).all()
    assert np.isnan(t.sigma[land]).all()
    islet = np.hypot(longitude - 10.015, (latitude - 54.015) / 0.59) == np.hypot(
        longitude - 10.015, (latitude - 54.015) / 0.59).min()  # fmt: skip
    assert (t.z[islet] == -2.0).all()


def test_doubt_joins_the_hold_out_and_the_zone_of_confidence(made: DescribedTerrain) -> None:
    t = made.terrain
    assert t.sigma is not None
    water = np.isfinite(t.sigma)
    zone = (1.0 + 0.02 * t.z) / 1.96  # CATZOC A2
    assert (t.sigma[water] >= zone[water] - 0.02).all()
    assert t.sigma[water].max() < 2.0
    assert made.hold_out is not None
    assert made.hold_out.median < 0.06


def test_what_stands_in_the_water_becomes_obstacles(made: DescribedTerrain) -> None:
    found = {o.name: o for o in made.obstacles}
    wreck = found["Erna WRECKS"]
    assert isinstance(wreck, Cylinder)
    assert wreck.centre[2] - wreck.half_height == pytest.approx(5.5, abs=0.02)
    bottom = depth_at(np.array(10.01))
    assert wreck.centre[2] + wreck.half_height == pytest.approx(bottom, abs=0.5)
    assert isinstance(found["PILPNT"], Cylinder)
    assert isinstance(found["BOYLAT"], Sphere)
    mooring = found["mooring of BOYLAT"]
    assert isinstance(mooring, Capsule)
    assert mooring.end[2] == pytest.approx(depth_at(np.array(10.012)), abs=0.5)
    assert isinstance(found["PIPSOL"], Capsule)
    pontoon = found["PONTON"]
    assert isinstance(pontoon, Box)
    assert pontoon.centre[2] + pontoon.half[2] == pytest.approx(0.5)  # its draught
    assert sorted(pontoon.half[:2]) == pytest.approx([16.4, 16.7], abs=0.3)
    assert "OBSTRN" not in found  # foul ground is no body
    assert any("1 foul areas" in n for n in made.notes)


def test_the_seabeds_nature_is_that_of_the_nearest_statement(made: DescribedTerrain) -> None:
    assert made.terrain.materials == ("unknown", "sand")
    assert made.terrain.material is not None
    assert made.terrain.material.max() == 1


def test_updates_are_applied_in_their_sequence(tmp_path: Path) -> None:
    base = slope()
    gone = base.point("WRECKS", (10.01, 54.01), VALSOU=5.0)
    chart = base.write(tmp_path / "A.000")
    one = Cell(is_update=True, update=1, first=5000)
    one.soundings([(10.0111, 54.0111, 12.3)])
    one.write(tmp_path / "A.001")
    two = Cell(is_update=True, update=2, first=6000)
    two.delete(gone)
    two.write(tmp_path / "A.002")
    made = chart_terrain(chart)
    assert made.facts["updates"] == "A.001, A.002; the chart is at update 2"
    assert made.facts["known"].startswith("145 soundings")
    assert made.obstacles == ()
    assert "edition 3, update 2" in made.terrain.source


def test_a_missing_update_is_named_and_what_follows_is_not_applied(tmp_path: Path) -> None:
    chart = slope().write(tmp_path / "A.000")
    for number in (1, 3, 4):
        update = Cell(is_update=True, update=number, first=5000 + 100 * number)
        update.soundings([(10.0111, 54.0111 + 1e-4 * number, 12.3)])
        update.write(tmp_path / f"A.{number:03d}")
    made = chart_terrain(chart)
    assert made.facts["known"].startswith("145 soundings")
    assert any(
        "A.002 is missing" in n and "A.003, A.004 cannot be applied" in n and "update 1" in n
        for n in made.notes
    )


@pytest.mark.parametrize("damage", [lambda b: b[:-10], lambda b: b[:60], lambda b: b"a letter"])
def test_a_damaged_update_is_named_and_not_applied(tmp_path: Path, damage: Any) -> None:
    chart = slope().write(tmp_path / "A.000")
    update = Cell(is_update=True, update=1, first=5000)
    update.soundings([(10.0111, 54.0112, 12.3)])
    file = update.write(tmp_path / "A.001")
    file.write_bytes(damage(file.read_bytes()))
    made = chart_terrain(chart)
    assert made.facts["known"].startswith("144 soundings")
    assert any("A.001" in n and "not applied" in n and "update 0" in n for n in made.notes)


def test_a_reissued_cell_goes_on_where_it_stands(tmp_path: Path) -> None:
    chart = slope(update=4).write(tmp_path / "A.000")
    for number in (4, 5):  # 4 is in the reissue
        update = Cell(is_update=True, update=number, first=5000 + 100 * number)
        update.soundings([(10.0111, 54.0111 + 1e-4 * number, 12.3)])
        update.write(tmp_path / f"A.{number:03d}")
    made = chart_terrain(chart)
    assert made.facts["updates"] == "A.005; the chart is at update 5"
    assert made.facts["known"].startswith("145 soundings")


def test_an_update_of_another_edition_is_not_applied(tmp_path: Path) -> None:
    chart = slope().write(tmp_path / "A.000")
    Cell(is_update=True, update=1, edition="2").write(tmp_path / "A.001")
    notes = chart_terrain(chart).notes
    assert any("A.001 belongs to edition 2, the base cell is edition 3" in n for n in notes)


def test_depths_in_feet_become_metres(tmp_path: Path) -> None:
    metres = chart_terrain(slope().write(tmp_path / "M.000"), 50.0)
    feet = chart_terrain(slope(duni=3).write(tmp_path / "F.000"), 50.0)
    wet = metres.terrain.z > 0
    np.testing.assert_allclose(feet.terrain.z[wet], 0.3048 * metres.terrain.z[wet], atol=0.01)
    assert any("charted in ft: converted" in n for n in feet.notes)


@pytest.mark.parametrize(("west", "south", "code"), [(-70.2, -33.4, 32719), (4.0, 60.0, 32631)])
def test_the_projection_is_the_zone_at_the_charts_middle(
    tmp_path: Path, west: float, south: float, code: int
) -> None:
    made = chart_terrain(slope(west=west, south=south).write(tmp_path / "A.000"), 50.0)
    assert made.terrain.crs == f"EPSG:{code}"
    assert np.nanmax(made.terrain.z) > 35


def test_a_chart_may_cross_the_anti_meridian(tmp_path: Path) -> None:
    cell, west = Cell(), 179.99

    def turned(ring: list[tuple[float, float]]) -> list[tuple[float, float]]:
        return [(x - 360 if x > 180 else x, y) for x, y in ring]

    cell.area("DEPARE", turned(rectangle(west, 0, west + 0.02, 0.02)), DRVAL1=0)
    grid = np.linspace(0.001, 0.019, 8)
    cell.soundings([(*turned([(west + u, v)])[0], 1000 * u) for u in grid for v in grid])
    t = chart_terrain(cell.write(tmp_path / "A.000"), 50.0).terrain
    assert t.z.shape[1] == pytest.approx(0.02 * 111_320 / 50, abs=3)
    assert t.z[20, -5] > t.z[20, 5] + 10


def test_an_area_without_bounds_and_soundings_above_the_datum(tmp_path: Path) -> None:
    cell = Cell()
    cell.area("DEPARE", rectangle(10, 54, 10.01, 54.01))
    grid = np.linspace(0.0005, 0.0095, 6)
    cell.soundings([(10 + u, 54 + v, 400 * u - 1.5) for u in grid for v in grid])
    made = chart_terrain(cell.write(tmp_path / "A.000"), 20.0)
    assert np.nanmin(made.terrain.z) == pytest.approx(-1.3, abs=0.1)
    assert made.in_band == 1.0


def test_no_sliver_spans_a_bay_along_the_charts_edge(tmp_path: Path) -> None:
    cell, west = Cell(), 10.0
    east = west + 0.02
    cell.area("DEPARE", rectangle(west, 54, west + 0.002, 54.02), DRVAL1=0, DRVAL2=5)
    cell.area("DEPARE", rectangle(west + 0.002, 54, east - 0.002, 54.02), DRVAL1=5, DRVAL2=99)
    cell.area("DEPARE", rectangle(east - 0.002, 54, east, 54.02), DRVAL1=0, DRVAL2=5)
    for x in (west + 0.002, east - 0.002):
        cell.line("DEPCNT", [(x, 54), (x, 54.02)], VALDCO=5)
    grid = np.linspace(0.004, 0.016, 7)
    cell.soundings([(west + u, 54 + v, 60.0) for u in grid for v in grid])
    t = chart_terrain(cell.write(tmp_path / "A.000"), 20.0).terrain
    middle = t.z[:, t.z.shape[1] // 2]
    assert np.nanmin(middle) > 40  # not the contours' 5 m, though their ends are the hull


def records_of(file: Path) -> list[bytes]:
    data, found = file.read_bytes(), []
    while data:
        length = int(data[:5])
        found.append(data[:length])
        data = data[length:]
    return found


def test_a_cell_that_is_cut_between_two_records_is_refused_with_the_numbers(tmp_path: Path) -> None:
    file = slope().write(tmp_path / "XX5TEST1.000")
    records = records_of(file)
    read_chart(file)
    for n in range(2, len(records)):
        file.write_bytes(b"".join(records[:n]))
        with pytest.raises(
            InputInvalid,
            match=r"incomplete: its DSSI field states \d+ (feature|spatial) records and",
        ):
            read_chart(file)


def test_an_update_that_is_cut_between_two_records_is_not_applied(tmp_path: Path) -> None:
    file = slope().write(tmp_path / "XX5TEST1.000")
    update = Cell(is_update=True, update=1, first=9000)
    update.soundings([(10.01, 54.01, 3.0)])
    update.point("WRECKS", (10.011, 54.011))
    cut = update.write(tmp_path / "XX5TEST1.001")
    cut.write_bytes(b"".join(records_of(cut)[:-1]))
    chart = read_chart(file)
    assert chart.files.updates == ()
    assert "incomplete" in chart.notes[0]
    assert "the chart remains at update 0" in chart.notes[0]


def test_a_damaged_file_is_refused_at_its_place(tmp_path: Path) -> None:
    chart = slope().write(tmp_path / "A.000")
    chart.write_bytes(chart.read_bytes()[:-10])
    with pytest.raises(InputInvalid, match=r"damaged at byte .* ends 10 bytes behind the file"):
        chart_terrain(chart)


def test_an_unsurveyed_area_stays_unknown(tmp_path: Path) -> None:
    cell = slope()
    cell.area("UNSARE", rectangle(10.008, 54.008, 10.012, 54.012))
    made = chart_terrain(cell.write(tmp_path / "A.000"), 20.0)
    longitude, latitude = _degrees(made)
    hole = (np.abs(longitude - 10.01) < 0.0015) & (np.abs(latitude - 54.01) < 0.0015)
    assert np.isnan(made.terrain.z[hole]).all()


def test_without_soundings_the_contours_are_triangulated_and_it_is_said(tmp_path: Path) -> None:
    made = chart_terrain(slope(count=0).write(tmp_path / "A.000"), 50.0)
    assert any("no soundings" in n for n in made.notes)
    assert made.facts["soundings left out"] == "no soundings"
    assert np.isfinite(made.terrain.z).any()


def test_invented_relief_is_seeded_and_said_and_stays_in_its_band(tmp_path: Path) -> None:
    chart = slope(count=5).write(tmp_path / "A.000")
    plain, one, same, other = (chart_terrain(chart, 20.0, relief=k) for k in (None, 1, 1, 2))
    np.testing.assert_array_equal(one.terrain.z, same.terrain.z)
    assert not np.array_equal(one.terrain.z, other.terrain.z, equal_nan=True)
    assert not np.array_equal(one.terrain.z, plain.terrain.z, equal_nan=True)
    assert "invented (seed 1)" in one.terrain.source
    assert any("no sounding measured it" in n for n in one.notes)
    longitude, _ = _degrees(one)
    deep = longitude > SHORE + 0.55 * (EAST - SHORE)
    assert np.nanmin(one.terrain.z[deep]) >= 20.0


def test_a_piece_is_the_same_as_in_the_whole(tmp_path: Path) -> None:
    chart = slope().write(tmp_path / "A.000")
    whole = chart_terrain(chart, 20.0).terrain
    piece = chart_terrain(chart, 20.0, piece_of("54.01,10.01", "0.4x0.6")).terrain
    i = round((piece.northing + piece.origin[0] - whole.northing - whole.origin[0]) / 20)
    j = round((piece.easting + piece.origin[1] - whole.easting - whole.origin[1]) / 20)
    rows, columns = piece.z.shape
    np.testing.assert_array_equal(piece.z, whole.z[i : i + rows, j : j + columns])


def _only_area(path: Path) -> None:
    cell = Cell()
    cell.area("DEPARE", rectangle(10, 54, 10.01, 54.01), DRVAL1=0, DRVAL2=5)
    cell.write(path)


def _only_soundings(path: Path) -> None:
    cell = Cell()
    cell.soundings([(10 + k / 1000, 54 + k * k / 1e5, 5.0) for k in range(9)])
    cell.write(path)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda p: p.write_bytes(b""), "is empty"),
        (
            lambda p: p.write_text("no chart at all, only words that go on for a while"),
            "not an S-57",
        ),
        (lambda p: p.write_bytes(p.read_bytes()[:1500]), "A.000"),
        (lambda p: slope(duni=2).write(p), "fathoms"),
        (lambda p: Cell().write(p), "the cell is empty"),
        (_only_area, "no soundings and no depth contours"),
        (_only_soundings, "no depth area"),
        (lambda p: Cell(is_update=True, update=7).write(p), "this is update 7"),
    ],
)
def test_what_is_no_seabed_is_refused_in_words(tmp_path: Path, spoil: object, said: str) -> None:
    chart = slope().write(tmp_path / "A.000")
    spoil(chart)  # type: ignore[operator]
    with pytest.raises(InputInvalid, match=said):
        chart_terrain(chart)


def test_more_nodes_than_memory_bears_are_refused_with_what_fits(tmp_path: Path) -> None:
    chart = slope().write(tmp_path / "A.000")
    with pytest.raises(InputInvalid, match=r"--resolution 0\.4 fits, or a piece by --around"):
        chart_terrain(chart, 0.1)


def test_a_piece_beside_the_chart_is_refused_with_where_the_chart_is(tmp_path: Path) -> None:
    chart = slope().write(tmp_path / "A.000")
    with pytest.raises(InputInvalid, match=r"outside what is charted: latitude 54\.0000 to 54\.02"):
        chart_terrain(chart, 10.0, piece_of("40,-70", "1"))


def test_tiles_are_the_terrain_as_a_whole(tmp_path: Path) -> None:
    import rasterio

    from uuvsim_cosim.scene.terrain.chart import write_large

    chart = slope().write(tmp_path / "A.000")
    target = tmp_path / "a.tif"
    assert write_large(chart, target, 10.0, None, None) is None
    assert not target.exists()
    large = write_large(chart, target, 10.0, None, None, tile=64, above=1000)
    assert large is not None
    assert "in tiles of 64" in large.facts["grid"]
    t = chart_terrain(chart, 10.0).terrain
    with rasterio.open(target) as file:
        z, sigma = -file.read(1), file.read(2)
        east = t.easting + t.origin[1]
        north = t.northing + t.origin[0] + 10 * (t.z.shape[0] - 1)
        row, column = file.index(east, north)
    cut = np.s_[row : row + t.z.shape[0], column : column + t.z.shape[1]]
    np.testing.assert_array_equal(z[cut], t.z[::-1])
    assert t.sigma is not None
    np.testing.assert_allclose(sigma[cut], t.sigma[::-1], atol=0.02)
    assert np.isfinite(z).sum() == np.isfinite(t.z).sum()
