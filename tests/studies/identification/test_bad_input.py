"""Bad logs at the command line: one message with place and expectation, and nothing written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.studies.identification.readers.ardusub_logs import HEAVY, dataflash, tlog
from tests.studies.identification.readers.bag_files import bag, commands, numbers, odometry
from tests.studies.identification.readers.ulog_files import HEAVY_ROTORS, ulog
from uuvsim_cosim.cli import status_of

Made = Callable[[Path], Path]


def cut(path: Path, size: int) -> Path:
    path.write_bytes(path.read_bytes()[:size])
    return path


def table(folder: Path, angle: str, times: str = "{:.1f}") -> Path:
    path = folder / "dive.csv"
    rows = (f"{times.format(k / 10)},5,0,{angle},0,1,{'0.1,' * 7}0.1\n" for k in range(60))
    names = ",".join(f"u[{k}]" for k in range(1, 9))
    path.write_text(
        f"time,depth,attitude[1],attitude[2],attitude[3],armed,{names}\n" + "".join(rows)
    )
    return path


def turned(path: Path) -> Path:
    """Write a heading of 90 into a table."""
    path.write_text(path.read_text().replace(",5,0,0,0,", ",5,0,0,90,"))
    return path


def percent(path: Path) -> Path:
    """Write the commands of a table in percent."""
    path.write_text(path.read_text().replace(",0.1", ",10"))
    return path


BAD: dict[str, tuple[Made, str]] = {
    "truncated CSV": (
        lambda d: cut(table(d, "0"), 1000), r"dive\.csv:\d+: \d+ values; expected 14",
    ),
    "truncated ULog": (lambda d: cut(ulog(d / "1.ulg"), 1500), r"1\.ulg: .*after 1500 bytes"),
    "truncated bag": (
        lambda d: cut(next(bag(d / "b", odometry(), commands([0.1] * 8)).glob("*.mcap")), 5000),
        r"b\.mcap: cannot be read .*expected a complete bag",
    ),
    "copter of ArduPilot": (
        lambda d: dataflash(d / "1.BIN", firmware="ArduCopter V4.3.6"), r"a log of ArduCopter",
    ),
    "copter of PX4": (lambda d: ulog(d / "1.ulg", HEAVY_ROTORS | {"MAV_TYPE": 2}), "type 2"),
    "without armed time": (
        lambda d: dataflash(d / "1.BIN", {**HEAVY, "LOG_DISARMED": 1}), "no part to fit.*disarmed",
    ),
    "clock that jumps back": (
        lambda d: tlog(tlog(d / "1.tlog", start=90_000)), r"jumps back from 95.900 to 5.000 s",
    ),
    "clock that jumps ahead": (
        lambda d: ulog(
            d / "1.ulg",
            times=[*range(5_000_000, 9_000_000, 10**5), *range(10**13, 10**13 + 10**6, 10**5)],
        ),
        r"jumps ahead by 1e\+07 s at 8.9",
    ),
    "two vehicles": (
        lambda d: bag(d / "b", odometry("/a/odom"), odometry("/b/odom"), commands([0.1] * 8)),
        "2 topics give the position: /a/odom, /b/odom; expected a bag of one vehicle",
    ),
    "missing parameters": (
        lambda d: dataflash(d / "1.BIN", {}), "lacks the parameters FRAME_CONFIG.*expected a log",
    ),
    "angles in degrees": (
        lambda d: table(d, "20"), "pitch reaches 20 at .*as if it were in degrees",
    ),
    "heading in degrees": (
        lambda d: turned(table(d, "0")), "yaw is 90 to 90 all the time, as if it were in degrees",
    ),
    "commands in percent": (
        lambda d: percent(table(d, "0")), r"u\[1\] is 10 at 0.000 s; expected commands from -1",
    ),
    "another vehicle": (
        lambda d: dataflash(d / "1.BIN"),
        r"6 motors \(frame vectored\), and wrench has 8 thrusters",
    ),
    "no commands": (
        lambda d: bag(d / "b", odometry(), numbers("/motors", [0.0])),
        "lacks the thrusters' commands",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_log_gets_one_message_and_writes_nothing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make, message = BAD[name]
    path = make(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    asked = ["identify", str(path), "--system", "model:bluerov2_heavy", "-p", "D_q_66"]
    status = status_of([*asked, "--save-as", "my_rov@fit", "--manoeuvre", "next.csv"])
    said = capsys.readouterr()
    assert status == 2
    assert re.search(message, said.err)
    assert len(said.err.strip().splitlines()) == 1
    assert said.out == ""
    assert sorted(tmp_path.rglob("*")) == before
