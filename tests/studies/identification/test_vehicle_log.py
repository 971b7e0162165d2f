"""Times of a log: damaged ones are left out and reported, and a clock that jumps is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.studies.identification.readers.ardusub_logs import dataflash
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.logs import read_log
from uuvsim_cosim.studies.identification.vehicle_log import damaged_times

TIMES = np.arange(0.0, 20.0, 0.1)


@pytest.mark.parametrize("place", [0, 1, 50, 198, 199])
@pytest.mark.parametrize("wrong", [-500.0, 400_000.0, 1e9])
def test_one_wrong_time_is_found_wherever_it_is(place: int, wrong: float) -> None:
    t = TIMES.copy()
    t[place] = wrong
    lost = wrong < 0.0 and place == 0  # a pause of 500 s is one that a log may have
    expected = [] if lost else [place]
    assert np.flatnonzero(damaged_times(Path("1.BIN"), "ATT", t)).tolist() == expected


def test_a_clock_that_begins_again_is_refused_with_both_times() -> None:
    t = np.concatenate([TIMES, TIMES])
    with pytest.raises(InputInvalid, match=r"clock of ATT jumps back from 19.900 to 0.000 s"):
        damaged_times(Path("1.BIN"), "ATT", t)


def test_many_wrong_times_are_refused() -> None:
    t = TIMES.copy()
    t[5::20] -= 3.0
    with pytest.raises(InputInvalid, match="jumps back"):
        damaged_times(Path("1.BIN"), "ATT", t)


def flipped(path: Path, number: int, nth: int, bit: int) -> Path:
    """Flip a bit of the time of the nth message of a type."""
    data = bytearray(path.read_bytes())
    at = -1
    for _ in range(nth + 1):
        at = data.index(bytes([0xA3, 0x95, number]), at + 1)
    data[at + 3 + bit // 8] ^= 1 << (bit % 8)
    path.write_bytes(bytes(data))
    return path


@pytest.mark.parametrize(("number", "name"), [(10, "ATT"), (13, "RCOU"), (12, "IMU"), (14, "BAT")])
@pytest.mark.parametrize("bit", [19, 24, 40, 62])
def test_a_flipped_bit_of_a_time_costs_one_message(
    number: int, name: str, bit: int, tmp_path: Path
) -> None:
    whole = read_log(dataflash(tmp_path / "1.BIN"))
    found = read_log(flipped(dataflash(tmp_path / "2.BIN"), number, 22, bit))
    (remark,) = [r for r in found.metadata["remarks"] if "damaged" in r]
    assert remark.startswith(f"1 time of {name} damaged, and left out with the values: ")
    assert " after " in remark
    assert found.time[-1] == whole.time[-1]
    both = np.isin(whole.time, found.time)
    assert len(found.time) >= len(whole.time) - 1
    seen = np.isfinite(found["eta"])
    assert np.array_equal(found["eta"][seen], whole["eta"][both][seen])


def test_an_event_with_a_damaged_time_counts_at_its_place(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "1.BIN", events=[(11.0, 163), (12.0, 164)], samples=100)
    intact = read_log(path).metadata["excluded"]
    found = read_log(flipped(path, 17, 1, 30)).metadata
    assert [str(e) for e in intact] == ["4.0 to 5.0 s: at the surface (reported by the autopilot)"]
    assert found["excluded"][0].last == pytest.approx(intact[0].last, abs=0.1)
    assert any("1 of the 2 messages of EV have a damaged time" in r for r in found["remarks"])


def test_the_damaged_time_of_a_row_of_a_table_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "dive.csv"
    times = [f"{k / 10}" for k in range(60)]
    times[30] = "1003.0"
    path.write_text("time,nu[6],tau[6]\n" + "".join(f"{t},0.1,1\n" for t in times))
    found = read_log(path)
    assert len(found.time) == 59
    assert any("1 time of the column of time damaged" in r for r in found.metadata["remarks"])


def test_an_intact_log_has_no_remark_on_times(tmp_path: Path) -> None:
    assert not any(
        "damaged" in r for r in read_log(dataflash(tmp_path / "1.BIN")).metadata["remarks"]
    )
