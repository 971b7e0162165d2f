import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.commands.shared.waypoints import load_waypoints, local_of, origin_of
from uuvsim_cosim.errors import InputInvalid


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "head", ["", "n,e,d\n", "north,east,down\n", "# survey\n\nNorth [m],E,Down\n"]
)
def test_a_header_is_optional(tmp_path: Path, head: str) -> None:
    path = written(tmp_path, head + "0,0,5\n10, 2.5 ,5\n")
    np.testing.assert_array_equal(load_waypoints(path).points, [[0, 0, 5], [10, 2.5, 5]])


def test_named_columns_may_stand_in_any_order(tmp_path: Path) -> None:
    path = written(tmp_path, "down;north;east\n5;1;2\n6;3;4\n")
    np.testing.assert_array_equal(load_waypoints(path).points, [[1, 2, 5], [3, 4, 6]])


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("n,e,d\n0,0,5\n1,x,5\n", 3, "'x'"),
        ("0,0,5\n\n1,2\n", 3, "not 2"),
        ("0,0,5\n1,2,nan\n", 2, "finite"),
        ("0,0,5\n1,2,inf\n", 2, "finite"),
        ("lat,lon,d\n0,0,5\n", 1, "--origin"),
        ("0,0,5\nn,e,d\n", 2, "'n'"),
    ],
)
def test_a_wrong_line_is_named_with_what_was_read(
    tmp_path: Path, text: str, line: int, said: str
) -> None:
    with pytest.raises(InputInvalid) as raised:
        load_waypoints(written(tmp_path, text))
    assert f"mine.csv:{line}: " in str(raised.value)
    assert said in str(raised.value)


def test_one_waypoint_is_not_a_path(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="at least 2"):
        load_waypoints(written(tmp_path, "n,e,d\n0,0,5\n"))


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="no such file"):
        load_waypoints(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputInvalid, match="cannot be read"):
        load_waypoints(tmp_path / "b.csv")


# ---- degrees ----------------------------------------------------------------------------------

ORIGIN = (47.27, -122.55)


def test_the_plane_of_the_origin_agrees_with_the_topocentric_conversion_of_proj() -> None:
    import pyproj

    lat, lon = ORIGIN
    chain = (
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad "
        "+step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={lat} +lon_0={lon} +h_0=0"
    )
    convert = pyproj.Transformer.from_pipeline(chain)
    for place in [(47.28, -122.55), (47.27, -122.54), (47.3, -122.4), (46.9, -123.0)]:
        east, north, _ = convert.transform(place[1], place[0], 0.0)
        assert local_of(place, ORIGIN) == pytest.approx((north, east), abs=1e-6)


def test_a_table_in_degrees_is_placed_at_the_origin(tmp_path: Path) -> None:
    path = written(tmp_path, "lon,Latitude,depth [ft]\n-122.55,47.27,10\n-122.54,47.27,10\n")
    found = load_waypoints(path, ORIGIN)
    assert found.points[0] == pytest.approx([0, 0, 3.048])
    assert found.points[1] == pytest.approx([0.0485, 756.72, 3.048], abs=0.01)
    assert "true north" in found.notes[0]
    with pytest.raises(InputInvalid, match=r"mine.csv:1: .*--origin LAT,LON"):
        load_waypoints(path)


def test_a_unit_in_the_header_is_not_passed_over(tmp_path: Path) -> None:
    path = written(tmp_path, "north [ft],east (km),depth\n10,1,5\n20,2,5\n")
    assert load_waypoints(path).points[0] == pytest.approx([3.048, 1000.0, 5.0])
    with pytest.raises(InputInvalid, match="expected a unit such as m"):
        load_waypoints(written(tmp_path, "north [kg],east,depth\n10,1,5\n20,2,5\n"))


def test_a_place_far_from_the_origin_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "lat,lon,d\n-122.55,47.27,1\n47.27,-122.55,1\n")
    with pytest.raises(InputInvalid, match="km from the origin"):
        load_waypoints(path, ORIGIN)


def test_an_origin_for_metres_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="is in metres"):
        load_waypoints(written(tmp_path, "n,e,d\n0,0,5\n1,2,5\n"), ORIGIN)
    with pytest.raises(InputInvalid, match="has no header"):
        load_waypoints(written(tmp_path, "0,0,5\n1,2,5\n"), ORIGIN)


@pytest.mark.parametrize(
    "text",
    [
        "59.91,10.72,5\n59.92,10.73,5\n",
        "59.91,10.72,-5\n59.92,10.73,-5\n",  # before the depth is refused
        "-122.55;47.27;5\n-122.55;47.275;5\n",  # longitude first
        "47.2701,-122.5,5\n47.2701,-122.5,25\n",
        "59.91,10.72,5\n",
    ],
)
def test_a_table_without_header_that_may_be_in_degrees_is_refused(
    tmp_path: Path, text: str
) -> None:
    with pytest.raises(
        InputInvalid, match=r"mine.csv: has no header.* lat,lon,d .*--origin.*n,e,d"
    ):
        load_waypoints(written(tmp_path, text))
    in_metres = written(tmp_path, "n,e,d\n" + text.replace(";", ",").replace("-5", "5"))
    if text.count("\n") > 1:
        assert len(load_waypoints(in_metres).points) == 2


@pytest.mark.parametrize(
    "text",
    [
        "0,0,5\n10,2.5,5\n",
        "0,0,5\n0.5,0.5,5\n",  # a tank, near the origin
        "10,20,5\n10,20,30\n",  # a dive
        "59.91,10.72,5\n80.5,10.72,5\n",
        "150.5,120.5,5\n151,120.5,5\n",  # no place on the globe
    ],
)
def test_a_table_without_header_is_in_metres_and_says_so(tmp_path: Path, text: str) -> None:
    (note,) = load_waypoints(written(tmp_path, text)).notes
    assert note == "mine.csv has no header: its columns are read as north, east and down in m"
    assert load_waypoints(written(tmp_path, "n,e,d\n" + text)).notes == ()


@pytest.mark.parametrize("text", ["47", "a,b", "95,0", "1,2,3", "nan,0", ""])
def test_an_origin_that_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(InputInvalid, match="expected"):
        origin_of(text)


def test_a_refusal_does_not_repeat_a_long_line(tmp_path: Path) -> None:
    for text in ('{"a": ' + "1, " * 5000 + "}", "0,0," + "x" * 9000, "0,0,5," + "1," * 9000):
        with pytest.raises(InputInvalid) as raised:
            load_waypoints(written(tmp_path, text))
        assert len(str(raised.value)) < 400


# ---- QGroundControl ------------------------------------------------------------------------------


def item(command: int, *params: float | None, frame: int = 3) -> dict[str, Any]:
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": list(params)}


def plan(folder: Path, items: list[Any], home: Any = (47.27, -122.55, 0)) -> Path:
    path = folder / "mission.plan"
    mission = {"items": items, "plannedHomePosition": home, "version": 2}
    path.write_text(json.dumps({"fileType": "Plan", "mission": mission}))
    return path


def waypoint(lat: float, lon: float, altitude: float, **more: int) -> dict[str, Any]:
    return item(16, 0, 0, 0, None, lat, lon, altitude, **more)


def test_a_plan_is_placed_at_its_home_with_depths_below_it(tmp_path: Path) -> None:
    survey = {"type": "ComplexItem", "complexItemType": "survey",
              "TransectStyleComplexItem": {"Items": [waypoint(47.27, -122.54, -7)]}}  # fmt: skip
    found = load_waypoints(plan(tmp_path, [waypoint(47.27, -122.55, -5), survey]))
    assert found.points[:, 2] == pytest.approx([5, 7])
    assert found.points[0, :2] == pytest.approx([0, 0])
    assert found.points[1, 1] == pytest.approx(756.72, abs=0.01)
    assert any("the surface is taken to be at home" in n for n in found.notes)
    assert any("origin of the local frame is at 47.27, -122.55" in n for n in found.notes)


def test_what_a_plan_holds_and_is_not_flown_is_reported(tmp_path: Path) -> None:
    items = [item(178, 1, 2, -1, 0, 0, 0, 0), item(20, 0, 0, 0, 0, 0, 0, 0),
             item(16, 9, 0, 0, None, 47.27, -122.55, -5), waypoint(47.28, -122.55, -5)]  # fmt: skip
    notes = "\n".join(load_waypoints(plan(tmp_path, items)).notes)
    assert "1 item(s) with command 178 are ignored" in notes
    assert "1 item(s) with command 20 are ignored" in notes
    assert "item 3: its hold of 9 s is ignored" in notes


@pytest.mark.parametrize(
    ("items", "said"),
    [
        ([waypoint(47.27, -122.55, 5)], "item 1: altitude 5 m; expected 0 m or less"),
        ([waypoint(47.27, -122.55, -5, frame=10)], "item 1: altitude in frame 10"),
        ([item(16, 0, 0, 0, None, None, None, -5)], "item 1: has no place"),
        ([waypoint(47.27, -122.55, -5)], "at least 2"),
        ([{"type": "ComplexItem", "complexItemType": "StructureScan"}], "no plan"),
        ([], "at least 2"),
    ],
)
def test_a_plan_that_cannot_be_flown_is_refused(
    tmp_path: Path, items: list[Any], said: str
) -> None:
    with pytest.raises(InputInvalid, match=re.escape(said)):
        load_waypoints(plan(tmp_path, items))


def test_a_plan_without_home_needs_an_origin(tmp_path: Path) -> None:
    path = plan(tmp_path, [waypoint(47.27, -122.55, -5), waypoint(47.28, -122.55, -5)], None)
    with pytest.raises(InputInvalid, match="expected --origin"):
        load_waypoints(path)
    assert load_waypoints(path, ORIGIN).points[0] == pytest.approx([0, 0, 5])
