"""Recordings in CSV as signals, and files of an autopilot's parameters."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.logs import read_log, read_parameter_file
from uuvsim_cosim.studies.identification.readers.channels import read_channels


def test_a_csv_may_have_units_arrays_or_the_columns_of_a_reference(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "time,nav.eta[1],nav.eta[2],psi\ns,m,km,deg\n0,1,2,90\n1,,3,180\n"
    )
    signals = read_log(tmp_path / "a.csv")
    assert signals["nav.eta"][0].tolist() == [1, 2000]
    assert np.isnan(signals["nav.eta"][1, 0])
    assert signals["psi"].tolist() == pytest.approx([pi / 2, pi])
    (tmp_path / "b.csv").write_text("# a note\nt_s,u_mps,r_rps,X_N\n0,0.5,0,7\n1,0.6,0,8\n")
    signals = read_log(tmp_path / "b.csv")
    assert signals["nu"][1, 0] == 0.6
    assert signals["tau"].tolist() == [[7, 0, 0, 0, 0, 0], [8, 0, 0, 0, 0, 0]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("a,b\n1,2\n", "expected one named time"),
        ("time,a,a\n0,1,2\n", "two columns 'a'"),
        ("time,a\n0,1\n1\n", r"bad.csv:3: 1 values; expected 2"),
        ("time,a\n0,1\n1,x\n", r"bad.csv:3: a = 'x'; expected a number"),
    ],
)
def test_a_csv_that_is_none_is_refused_with_its_line(
    text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputInvalid, match=message):
        read_log(tmp_path / "bad.csv")


def test_parameters_are_read_from_the_files_of_three_programs(tmp_path: Path) -> None:
    for name, text in (
        ("a.parm", "FRAME_CONFIG 1\nMOT_1_DIRECTION -1 # turned\n"),
        ("b.param", "FRAME_CONFIG,1\nMOT_1_DIRECTION,-1\n"),
        (
            "c.params",
            "# by QGroundControl\n1\t1\tFRAME_CONFIG\t1\t2\n1\t1\tMOT_1_DIRECTION\t-1\t2\n",
        ),
    ):
        (tmp_path / name).write_text(text)
        found = read_parameter_file(tmp_path / name)
        assert found == {"FRAME_CONFIG": 1.0, "MOT_1_DIRECTION": -1.0}
    (tmp_path / "d.parm").write_text("FRAME_CONFIG 1\nMOT_1_DIRECTION turned\n")
    with pytest.raises(InputInvalid, match=r"d.parm:2.*expected a name and a number"):
        read_parameter_file(tmp_path / "d.parm")


COLUMNS = "time,depth,attitude[1],attitude[2],attitude[3],armed,u[1],u[2]\n"


def rows(count: int, row: str, step: float = 0.1) -> str:
    return "".join(f"{k * step:.3f},{row}\n" for k in range(count))


def test_a_csv_with_quantities_of_a_vehicle_is_read_as_a_log(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(COLUMNS + rows(60, "5,0.1,0,1.5,1,0.5,-0.5"))
    signals = read_log(path)
    assert signals["eta"][0, 2:].tolist() == [5, 0.1, 0, 1.5]
    assert signals["u"][0].tolist() == [0.5, -0.5]
    for row, reason in (("0.1,0,0,0,1,0,0", "at the surface"), ("5,0,0,0,0,0,0", "disarmed")):
        path.write_text(COLUMNS + rows(60, row))
        with pytest.raises(InputInvalid, match=f"no part to fit: 0.0 to 5.9 s: {reason}"):
            read_log(path)


def test_columns_of_a_csv_are_assigned_with_units(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,roll,pitch,yaw,alt,pwm1,pwm2\n" + rows(60, "0,10,90,-5,1900,1300"))
    channels_of_pulses = "u=pwm1,pwm2?factor=0.0025&offset=-3.75"
    channels = read_channels(
        ["attitude=roll,pitch,yaw?unit=deg", "depth=alt?factor=-1", channels_of_pulses]
    )
    signals = read_log(path, None, channels)
    assert signals["eta"][0, 2:].tolist() == pytest.approx([5, 0, pi / 18, pi / 2])
    assert signals["u"][0].tolist() == pytest.approx([1.0, -0.5])
    with pytest.raises(InputInvalid, match=r"pitch reaches 10 at 0.000 s, as if it were in deg"):
        read_log(path, None, read_channels(["attitude=roll,pitch,yaw", channels_of_pulses]))
    with pytest.raises(InputInvalid, match=r"--channel depth=deep: no column 'deep'; expected"):
        read_log(path, None, read_channels(["depth=deep"]))


def test_a_truncated_csv_and_one_whose_clock_jumps_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    whole = COLUMNS + rows(60, "5,0,0,0,1,0,0")
    path.write_text(whole[:-8])
    with pytest.raises(InputInvalid, match=r"a.csv:61: 5 values; expected 8"):
        read_log(path)
    path.write_text(whole + rows(60, "5,0,0,0,1,0,0"))
    with pytest.raises(InputInvalid, match=r"jumps back from 5.900 to 0.000 s"):
        read_log(path)
    path.write_text(whole + "".join(f"{17 * 10**8 + k},5,0,0,0,1,0,0\n" for k in range(4)))
    with pytest.raises(InputInvalid, match=r"the clock jumps ahead by 1.7e\+09 s at 5.900 s"):
        read_log(path)


def test_an_angle_in_degrees_is_found_by_its_full_turns(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    turns = "".join(f"{k * 0.1:.1f},5,0,0,{(k * 7) % 360},1,0,0\n" for k in range(80))
    path.write_text(COLUMNS + turns)
    with pytest.raises(InputInvalid, match=r"yaw reaches 3.* as if it were in degrees"):
        read_log(path)


def test_a_recording_of_this_package_has_no_channels(tmp_path: Path) -> None:
    (tmp_path / "a.parquet").write_bytes(b"x")
    with pytest.raises(InputInvalid, match=r"a recording of a run; expected --map"):
        read_log(tmp_path / "a.parquet", None, read_channels(["depth=x"]))


def test_signals_in_a_csv_have_one_clock_too(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,nu[1]\n" + rows(60, "1") + rows(60, "1"))
    with pytest.raises(InputInvalid, match=r"jumps back from 5.900 to 0.000 s"):
        read_log(path)
    later = "".join(f"{17 * 10**8 + k},1\n" for k in range(4))
    path.write_text("time,nu[1]\n" + rows(60, "1") + later)
    with pytest.raises(InputInvalid, match=r"jumps ahead by 1.7e\+09 s at 5.900 s"):
        read_log(path)


def test_units_of_a_csv_are_those_of_its_quantities_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for name, unit, value, expected in (
        ("nu[1]", "cm/s", 100, 1.0), ("nu[6]", "[deg/s]", 180, pi), ("eta[4]", "degrees", 180, pi),
        ("eta[3]", "ft", 10, 3.048), ("tau[1]", "kN", 2, 2e3), ("tau[4]", "Nm", 2, 2.0),
    ):  # fmt: skip
        path.write_text(f"time,{name}\nmsec,{unit}\n0,{value}\n100,{value}\n")
        signals = read_log(path)
        assert signals.time.tolist() == pytest.approx([0.0, 0.1])
        found = signals[name[:-3]][0]
        assert found[int(name[-2]) - 1] == pytest.approx(expected)
    for name, unit, message in (
        ("nu[1]", "furlong/h", r"a.csv:2: nu\[1\]: unit 'furlong/h' is unknown; .* a unit of m/s"),
        ("nu[6]", "m/s", r"nu\[6\]: unit 'm/s'; expected a unit of rad/s"),
        ("depth", "deg", "depth: unit 'deg'; expected a unit of m"),
        ("speed", "PSU", "speed: unit 'PSU' is unknown; expected a unit such as"),
    ):
        path.write_text(f"time,{name}\ns,{unit}\n0,1\n1,1\n")
        with pytest.raises(InputInvalid, match=message):
            read_log(path)


def test_a_column_is_not_converted_twice(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,roll,pitch,yaw,u[1]\ns,deg,deg,deg,\n" + rows(60, "0,10,90,0.5"))
    signals = read_log(path, None, read_channels(["attitude=roll,pitch,yaw"]))
    assert signals["eta"][0, 3:].tolist() == pytest.approx([0, pi / 18, pi / 2])
    channels = read_channels(["attitude=roll,pitch,yaw?unit=deg"])
    with pytest.raises(InputInvalid, match="line of units has deg for roll"):
        read_log(path, None, channels)


def test_forces_are_not_held_over_a_gap_in_a_csv(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    lines = [f"{k / 10},1,{'' if 20 < k < 50 else 3}\n" for k in range(90)]
    path.write_text("time,hull.nu[1],hull.tau[1]\n" + "".join(lines))
    (gap,) = read_log(path).metadata["excluded"]
    assert str(gap) == "2.0 to 5.0 s: no number of hull.tau"


def test_elements_of_a_force_that_no_column_has_are_0_and_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,nu[1],tau[1],tau[2],tau[6]\n" + rows(9, "1,2,3,4"))
    signals = read_log(path)
    assert signals["tau"][0].tolist() == [2, 3, 0, 0, 0, 4]
    assert signals.metadata["remarks"] == ("not in the file, and 0: tau[3], tau[4], tau[5]",)
