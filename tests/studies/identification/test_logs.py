"""Logs as signals: CSV, and ArduSub's .tlog and .BIN, written here by pymavlink and by hand."""

from __future__ import annotations

import struct
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.logs import read_log

PWM = [1500, 1900, 1100, 1700, 1300, 1500]


def tlog(path: Path, kinds: tuple[str, ...] = ("ATTITUDE", "LOCAL", "SERVO", "SYS")) -> Path:
    """Two seconds at 10 Hz: heading east at 1 m/s, as an autopilot sends them."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    with path.open("wb") as file:
        link: Any = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        for k in range(20):
            ms = 5000 + 100 * k
            messages = {
                "SERVO": link.servo_output_raw_encode(ms * 1000, 0, *PWM, 0, 0),
                "ATTITUDE": link.attitude_encode(ms, 0.1, 0.0, pi / 2, 0.01, 0.02, 0.03),
                "LOCAL": link.local_position_ned_encode(ms, 1.0, 0.1 * k, 5.0, 0.0, 1.0, 0.0),
                "SYS": link.sys_status_encode(0, 0, 0, 0, 15800, 100, 90, 0, 0, 0, 0, 0, 0),
            }
            for kind in kinds:
                file.write(struct.pack(">Q", 1_700_000_000_000_000 + ms * 1000))
                file.write(messages[kind].pack(link))
    return path


class Dataflash:
    """A .BIN: each kind of message is described by an FMT message before it comes."""

    def __init__(self, path: Path) -> None:
        self.data = b""
        self.path = path
        self.formats: dict[str, tuple[int, str]] = {}
        self._format(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")

    def _format(self, number: int, name: str, format: str, columns: str) -> None:
        sizes = {"B": 1, "f": 4, "Q": 8, "n": 4, "N": 16, "Z": 64, "H": 2}
        length = 3 + sum(sizes[c] for c in format)
        self.formats[name] = (number, format)
        self.put("FMT", number, length, name.encode(), format.encode(), columns.encode())

    def describe(self, number: int, name: str, format: str, columns: str) -> None:
        self._format(number, name, format, columns)

    def put(self, name: str, *values: Any) -> None:
        number, format = self.formats[name]
        codes = {"n": "4s", "N": "16s", "Z": "64s"}
        layout = "<" + "".join(codes.get(c, c) for c in format)
        self.data += b"\xa3\x95" + bytes([number]) + struct.pack(layout, *values)

    def write(self) -> Path:
        self.path.write_bytes(self.data)
        return self.path


def dataflash(path: Path, commands: bool = True) -> Path:
    log = Dataflash(path)
    log.describe(10, "ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    log.describe(11, "XKF1", "QBfffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD")
    log.describe(12, "IMU", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ")
    log.describe(13, "RCOU", "QHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6")
    log.describe(14, "BAT", "QBf", "TimeUS,Inst,Volt")
    for k in range(20):
        us = 7_000_000 + 100_000 * k
        if commands:
            log.put("RCOU", us, *PWM)
        log.put("ATT", us + 20_000, 0, 5.0, 0, 0.0, 0, 90.0)
        for core in (0, 1):
            log.put("XKF1", us + 20_000, core, 5.0, 0, 90, 0, 1.0 + core, 0, 1.0, 0.1 * k, 5.0)
        log.put("IMU", us + 40_000, 0, 0.01, 0.02, 0.03)
        log.put("IMU", us + 40_000, 1, 9, 9, 9)
        log.put("BAT", us, 0, 15.8)
    return log.write()


def mean(values: Any) -> list[float]:
    return [float(v) for v in np.nanmean(np.asarray(values), axis=0)]


def test_a_tlog_has_attitude_position_and_commands(tmp_path: Path) -> None:
    signals = read_log(tlog(tmp_path / "dive.tlog"))
    assert signals.time[0] == 0
    assert signals.time[-1] == pytest.approx(1.9)
    assert mean(signals["eta"])[2:] == pytest.approx([5.0, 0.1, 0.0, pi / 2], abs=1e-6)
    # East at 1 m/s with the bow to the east is ahead: R(psi)' turns it to u.
    assert mean(signals["nu"]) == pytest.approx([1, 0, 0, 0.01, 0.02, 0.03], abs=1e-6)
    assert mean(signals["u"]) == [0, 1, -1, 0.5, -0.5, 0]
    assert np.nanmean(signals["voltage"]) == pytest.approx(15.8)


def test_a_dataflash_log_is_the_same_from_the_first_core_and_imu(tmp_path: Path) -> None:
    signals = read_log(dataflash(tmp_path / "00000001.BIN"))
    assert mean(signals["eta"])[2:] == pytest.approx([5.0, pi / 36, 0.0, pi / 2], abs=1e-6)
    assert mean(signals["nu"]) == pytest.approx([1, 0, 0, 0.01, 0.02, 0.03], abs=1e-6)
    assert mean(signals["u"]) == [0, 1, -1, 0.5, -0.5, 0]
    # Each message keeps its own time: attitude 20 ms after the commands, rates 40 ms.
    assert signals.time[np.isfinite(signals["eta"][:, 3])][0] == pytest.approx(0.02)
    assert signals.time[np.isfinite(signals["nu"][:, 3])][0] == pytest.approx(0.04)


def test_a_log_without_what_is_needed_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(
        InputInvalid, match=r"lacks the thrusters' commands \(RCOU.*there are ATTITUDE"
    ):
        read_log(tlog(tmp_path / "a.tlog", ("ATTITUDE", "LOCAL")))
    with pytest.raises(InputInvalid, match=r"lacks attitude or position"):
        read_log(tlog(tmp_path / "b.tlog", ("SERVO",)))
    with pytest.raises(InputInvalid, match=r"lacks the thrusters' commands"):
        read_log(dataflash(tmp_path / "c.BIN", commands=False))
    (tmp_path / "d.BIN").write_bytes(b"no log at all" * 10)
    with pytest.raises(InputInvalid, match=r"d\.BIN"):
        read_log(tmp_path / "d.BIN")
    (tmp_path / "e.tlog").write_bytes(b"")
    with pytest.raises(InputInvalid, match=r"e\.tlog"):
        read_log(tmp_path / "e.tlog")
    (tmp_path / "f.doc").write_bytes(b"x")
    with pytest.raises(InputInvalid, match=r"'.doc' is not read"):
        read_log(tmp_path / "f.doc")


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
