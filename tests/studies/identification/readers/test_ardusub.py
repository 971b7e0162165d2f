"""Logs of ArduSub: commands by its parameters, measurements, parts left out, and bad input."""

from __future__ import annotations

import re
import shutil
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.studies.identification.readers.ardusub_logs import (
    HEAVY,
    PWM,
    ROV,
    dataflash,
    parameters,
    tlog,
)
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.parameter_files import vehicle_folder
from uuvsim_cosim.studies.identification.exclusions import Excluded
from uuvsim_cosim.studies.identification.identify import identify
from uuvsim_cosim.studies.identification.logs import read_log
from uuvsim_cosim.studies.identification.readers.channels import read_channels

# u = -d (w - 1500) / 400 with the directions of ROV
U = [1.0, -1.0, -0.5, -0.5, 0.0, -0.25]


def mean(values: Any) -> list[float]:
    return [float(v) for v in np.nanmean(np.asarray(values), axis=0)]


def test_commands_follow_functions_and_directions_and_other_outputs_are_named(
    tmp_path: Path,
) -> None:
    signals = read_log(dataflash(tmp_path / "1.BIN"))
    assert mean(signals["u"]) == pytest.approx(U)
    assert signals.metadata["vehicle"] == "bluerov2"
    text = " ".join(signals.metadata["remarks"])
    assert "MOT_n_DIRECTION turns motors 1, 2, 4, 5" in text
    assert "13 (RC input 9, lights), 16 (camera tilt)" in text


def test_motors_may_be_at_any_output(tmp_path: Path) -> None:
    moved = {**ROV, "SERVO1_FUNCTION": 35, "SERVO3_FUNCTION": 33}
    signals = read_log(dataflash(tmp_path / "1.BIN", moved))
    # Output 1 drives motor 3 (direction 1) and output 3 motor 1 (direction -1).
    assert mean(signals["u"]) == pytest.approx([0.5, -1.0, -1.0, -0.5, 0.0, -0.25])


def test_commands_that_are_logged_slowly_are_named(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "a.BIN")
    remarks = " ".join(read_log(path).metadata["remarks"])
    assert "commands are in the log every 100 ms" in remarks
    fast = "time,attitude[1],attitude[2],attitude[3],u[1]\n"
    fast += "".join(f"{0.02 * k:.2f},0,0,0,0.5\n" for k in range(200))
    (tmp_path / "a.csv").write_text(fast)
    remarks = " ".join(read_log(tmp_path / "a.csv").metadata["remarks"])
    assert "commands are in the log" not in remarks


def test_eight_thrusters_make_a_heavy(tmp_path: Path) -> None:
    signals = read_log(dataflash(tmp_path / "1.BIN", HEAVY, pwm=(*PWM, 1540, 1460)))
    assert signals.metadata["vehicle"] == "bluerov2_heavy"
    assert mean(signals["u"]) == pytest.approx([*U, -0.1, 0.1])


def test_neutral_is_the_trim_unless_the_disarmed_output_differs(tmp_path: Path) -> None:
    trimmed = {**ROV, "SERVO5_TRIM": 1520}
    signals = read_log(dataflash(tmp_path / "1.BIN", trimmed))
    assert mean(signals["u"])[4] == pytest.approx(-0.05)
    events = [(9.0, 11), (9.5, 10)]
    signals = read_log(
        dataflash(tmp_path / "2.BIN", trimmed, pwm=(*PWM[:4], 1510, 1600), events=events)
    )
    assert mean(signals["u"])[4] == pytest.approx(0.0)
    assert any("rests at 1510 us while disarmed" in r for r in signals.metadata["remarks"])


@pytest.mark.parametrize("write", [dataflash, tlog])
def test_attitude_position_and_rates_are_in_si_units(write: Any, tmp_path: Path) -> None:
    signals = read_log(write(tmp_path / f"1.{'BIN' if write is dataflash else 'tlog'}"))
    roll = pi / 36 if write is dataflash else 0.1
    assert signals.time[0] == 0
    assert mean(signals["eta"])[2:] == pytest.approx([5.0, roll, 0.0, pi / 2], abs=1e-6)
    # East at 1 m/s with the bow to the east is ahead: R(psi)' turns it to u.
    assert mean(signals["nu"]) == pytest.approx([1, 0, 0, 0.01, 0.02, 0.03], abs=1e-6)
    assert mean(signals["u"]) == pytest.approx(U)
    assert np.nanmean(signals["voltage"]) == pytest.approx(15.8)


def test_other_components_with_clocks_of_their_own_are_not_read(tmp_path: Path) -> None:
    assert "range" not in read_log(tlog(tmp_path / "1.tlog"))


def test_each_message_keeps_its_own_time(tmp_path: Path) -> None:
    signals = read_log(dataflash(tmp_path / "1.BIN"))
    assert signals.time[np.isfinite(signals["eta"][:, 3])][0] == pytest.approx(0.02)
    assert signals.time[np.isfinite(signals["nu"][:, 3])][0] == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("status", "aided"), [(65767, False), (0, False), (1 << 3 | 1 << 7, False), (1 << 3, True)]
)
def test_an_estimator_without_aiding_gives_no_horizontal_position(
    status: int, aided: bool, tmp_path: Path
) -> None:
    signals = read_log(dataflash(tmp_path / "1.BIN", status=status))
    assert np.isfinite(signals["eta"][:, :2]).any() == aided
    assert np.isfinite(signals["nu"][:, :2]).any() == aided
    assert np.nanmean(signals["eta"][:, 2]) == pytest.approx(5.0)


def test_disarmed_and_reported_contacts_are_left_out_with_their_times(tmp_path: Path) -> None:
    events = [(7.0, 10), (8.0, 165), (9.0, 166), (12.5, 11)]
    signals = read_log(dataflash(tmp_path / "1.BIN", {**ROV, "LOG_DISARMED": 1}, events=events))
    excluded = [(e.first, e.last, e.reason.split(" (")[0]) for e in signals.metadata["excluded"]]
    assert excluded == [
        (0.0, 1.0, "shorter than 3 s between excluded parts"),
        (1.0, 2.0, "on the bottom"),
        (5.5, pytest.approx(5.94), "disarmed"),
    ]


def test_a_dive_at_the_surface_alone_or_without_armed_time_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"no part to fit: 0.0 to 5.9 s: at the surface"):
        read_log(dataflash(tmp_path / "1.BIN", depth=0.1))
    with pytest.raises(InputInvalid, match=r"no part to fit: 0.0 to 5.9 s: disarmed"):
        read_log(dataflash(tmp_path / "2.BIN", {**ROV, "LOG_DISARMED": 1}))
    with pytest.raises(InputInvalid, match=r"no part to fit: 0.0 to 5.9 s: disarmed"):
        read_log(tlog(tmp_path / "3.tlog", armed=False))


def test_a_vehicle_that_moves_with_resting_thrusters_is_under_tow(tmp_path: Path) -> None:
    at_rest = [1500] * 6
    signals = read_log(dataflash(tmp_path / "1.BIN", pwm=at_rest, samples=200))
    (towed,) = signals.metadata["excluded"]
    assert isinstance(towed, Excluded)
    assert towed.reason.startswith("under tow")
    assert towed.first == pytest.approx(5.0, abs=0.2)


def test_logs_without_what_is_needed_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"lacks the thrusters' commands"):
        read_log(tlog(tmp_path / "a.tlog", kinds=("ATTITUDE", "LOCAL")))
    with pytest.raises(InputInvalid, match=r"lacks attitude or position"):
        read_log(tlog(tmp_path / "b.tlog", kinds=("SERVO",)))
    with pytest.raises(InputInvalid, match=r"lacks the thrusters' commands"):
        read_log(dataflash(tmp_path / "c.BIN", without=["RCOU"]))
    (tmp_path / "e.tlog").write_bytes(b"")
    with pytest.raises(InputInvalid, match=r"e\.tlog"):
        read_log(tmp_path / "e.tlog")
    (tmp_path / "f.doc").write_bytes(b"x")
    with pytest.raises(InputInvalid, match=r"'.doc' is not read"):
        read_log(tmp_path / "f.doc")


def test_missing_parameters_are_refused_and_can_be_given(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "1.BIN", {})
    with pytest.raises(InputInvalid, match=r"lacks the parameters FRAME_CONFIG, SERVO1_FUNCTION"):
        read_log(path)
    assert mean(read_log(path, ROV)["u"]) == pytest.approx(U)
    unassigned = {k: v for k, v in ROV.items() if k != "SERVO4_FUNCTION"}
    with pytest.raises(InputInvalid, match=r"no output drives motor 4 of the frame vectored"):
        read_log(path, unassigned)
    twice = {**ROV, "SERVO9_FUNCTION": 33}
    with pytest.raises(InputInvalid, match=r"outputs 1 and 9 both drive motor 1"):
        read_log(path, twice)


def test_other_vehicles_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        InputInvalid, match=r"a log of ArduCopter V4.3.6.*expected a log of ArduSub"
    ):
        read_log(dataflash(tmp_path / "1.BIN", firmware="ArduCopter V4.3.6"))
    with pytest.raises(InputInvalid, match=r"FRAME_CLASS, a parameter of ArduCopter"):
        read_log(dataflash(tmp_path / "2.BIN", {"FRAME_CLASS": 1}, firmware=""))
    with pytest.raises(InputInvalid, match=r"a log of vehicle type 2; expected a submarine"):
        read_log(tlog(tmp_path / "3.tlog", kind=2))
    with pytest.raises(InputInvalid, match=r"messages of 2 vehicles \(systems 1, 7\)"):
        read_log(tlog(tmp_path / "4.tlog", systems=(1, 7)))


def test_a_clock_that_jumps_back_is_refused_and_a_gap_is_left_out(tmp_path: Path) -> None:
    path = tlog(tmp_path / "1.tlog", start=90_000)
    with pytest.raises(InputInvalid, match=r"clock of ATTITUDE jumps back from 95.900 to 5.000 s"):
        read_log(tlog(path))
    path = tlog(tmp_path / "2.tlog")
    (gap,) = read_log(tlog(path, start=30_000)).metadata["excluded"]
    assert (gap.first, gap.last) == pytest.approx((5.9, 25.0))
    assert gap.reason == "no commands in the log"


def test_two_logs_in_one_file_are_refused(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "1.BIN")
    path.write_bytes(path.read_bytes() * 2)
    with pytest.raises(InputInvalid, match=r"jumps back"):
        read_log(path)


def test_channels_name_a_message_and_its_columns(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "1.BIN")
    chosen = read_channels(["depth=XKF1:PD?factor=2", "attitude=ATT:Roll,Pitch,Yaw?unit=deg"])
    signals = read_log(path, None, chosen)
    assert mean(signals["eta"])[2:] == pytest.approx([10.0, pi / 36, 0.0, pi / 2], abs=1e-6)
    with pytest.raises(InputInvalid, match=r"no message or column 'XKF1:PX'; expected MESSAGE:COL"):
        read_log(path, None, read_channels(["depth=XKF1:PX"]))
    with pytest.raises(InputInvalid, match=r"a .tlog has no channels"):
        read_log(tlog(tmp_path / "1.tlog"), None, chosen)


def test_logs_that_end_within_a_message_report_it(tmp_path: Path) -> None:
    for path in (dataflash(tmp_path / "1.BIN"), tlog(tmp_path / "1.tlog")):
        path.write_bytes(path.read_bytes()[:-5])
        remarks = " ".join(read_log(path).metadata["remarks"])
        assert re.search(r"the log ends within a (message|packet): its last \d+ bytes", remarks)


def test_the_system_of_another_vehicle_is_refused(tmp_path: Path) -> None:
    path = dataflash(tmp_path / "1.BIN")
    with pytest.raises(InputInvalid, match=r"6 motors \(frame vectored\), and wrench has 8 thru"):
        identify(path, "model:bluerov2_heavy", ["D_q_66"])
    custom = parameters(7, [1, 1, 1])
    with pytest.raises(InputInvalid, match=r"does not name a vehicle.*frame custom.*--system"):
        identify(dataflash(tmp_path / "2.BIN", custom), None, ["D_q_66"])


def test_a_log_of_another_vehicle_with_as_many_thrusters_is_noted(tmp_path: Path) -> None:
    shutil.copytree(vehicle_folder("bluerov2"), tmp_path / "my_rov")
    file = tmp_path / "my_rov" / "parameters.yaml"
    file.write_text(file.read_text().replace("id: bluerov2", "id: my_rov", 1))
    thrusters = tmp_path / "my_rov" / "thrusters.yaml"
    thrusters.write_text(thrusters.read_text().replace("vehicle: bluerov2", "vehicle: my_rov", 1))
    path = dataflash(tmp_path / "1.BIN")
    found = identify(path, f"model:{tmp_path / 'my_rov'}", ["D_q_66"], proposals=False)
    assert "the log is of bluerov2, by its frame, and the fitted hull is my_rov" in found.notes
    own = identify(path, None, ["D_q_66"], proposals=False)
    assert not any("by its frame, and the fitted hull" in n for n in own.notes)
