from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.waypoints import read_waypoints


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "head", ["", "n,e,d\n", "north,east,down\n", "# survey\n\nNorth [m],E,Down\n"]
)
def test_a_header_is_optional(tmp_path: Path, head: str) -> None:
    path = written(tmp_path, head + "0,0,5\n10, 2.5 ,5\n")
    np.testing.assert_array_equal(read_waypoints(path), [[0, 0, 5], [10, 2.5, 5]])


def test_named_columns_may_stand_in_any_order(tmp_path: Path) -> None:
    path = written(tmp_path, "down;north;east\n5;1;2\n6;3;4\n")
    np.testing.assert_array_equal(read_waypoints(path), [[1, 2, 5], [3, 4, 6]])


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("n,e,d\n0,0,5\n1,x,5\n", 3, "'x'"),
        ("0,0,5\n\n1,2\n", 3, "not 2"),
        ("0,0,5\n1,2,nan\n", 2, "finite"),
        ("0,0,5\n1,2,inf\n", 2, "finite"),
        ("lat,lon,d\n0,0,5\n", 1, "n,e,d"),
        ("0,0,5\nn,e,d\n", 2, "'n'"),
    ],
)
def test_a_wrong_line_is_named_with_what_was_read(
    tmp_path: Path, text: str, line: int, said: str
) -> None:
    with pytest.raises(InputInvalid) as raised:
        read_waypoints(written(tmp_path, text))
    assert f"mine.csv:{line}: " in str(raised.value)
    assert said in str(raised.value)


def test_one_waypoint_is_not_a_path(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="at least 2"):
        read_waypoints(written(tmp_path, "n,e,d\n0,0,5\n"))


def test_a_missing_or_binary_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match="no such file"):
        read_waypoints(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputInvalid, match="cannot be read"):
        read_waypoints(tmp_path / "b.csv")
