"""Small logs of ArduSub, written here: .BIN by struct, .tlog by pymavlink."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from math import pi
from pathlib import Path
from typing import Any

__all__ = ["HEAVY", "PWM", "ROV", "Dataflash", "dataflash", "parameters", "tlog"]

PWM = (1900, 1100, 1700, 1300, 1500, 1600)
_SIZES = {"B": 1, "b": 1, "f": 4, "Q": 8, "n": 4, "N": 16, "Z": 64, "H": 2, "C": 2, "I": 4}
_CODES = {"n": "4s", "N": "16s", "Z": "64s", "C": "H"}


def parameters(frame: int, directions: Sequence[int], **others: float) -> dict[str, float]:
    """Parameters of a vehicle with a motor at each output, lights at 13 and a tilt at 16."""
    found: dict[str, float] = {"FRAME_CONFIG": frame, "SERVO13_FUNCTION": 59, "SERVO16_FUNCTION": 7}
    for i, d in enumerate(directions, 1):
        found |= {f"SERVO{i}_FUNCTION": 32 + i, f"MOT_{i}_DIRECTION": d, f"SERVO{i}_TRIM": 1500}
    return found | others


ROV = parameters(1, [-1, -1, 1, -1, -1, 1])
HEAVY = parameters(2, [-1, -1, 1, -1, -1, 1, 1, 1])


class Dataflash:
    """A .BIN: each kind of message is described by an FMT message before it comes."""

    def __init__(self) -> None:
        self.data = b""
        self.formats: dict[str, tuple[int, str]] = {}
        self.describe(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")

    def describe(self, number: int, name: str, format: str, columns: str) -> None:
        length = 3 + sum(_SIZES[c] for c in format)
        self.formats[name] = (number, format)
        self.put("FMT", number, length, name.encode(), format.encode(), columns.encode())

    def put(self, name: str, *values: Any) -> None:
        number, format = self.formats[name]
        layout = "<" + "".join(_CODES.get(c, c) for c in format)
        self.data += b"\xa3\x95" + bytes([number]) + struct.pack(layout, *values)


def dataflash(
    path: Path,
    settings: Mapping[str, float] = ROV,
    *,
    pwm: Sequence[int] = PWM,
    firmware: str = "ArduSub V4.5.0 (0123abcd)",
    depth: float = 5.0,
    events: Sequence[tuple[float, int]] = (),
    status: int | None = None,
    without: Sequence[str] = (),
    samples: int = 60,
) -> Path:
    """Write six seconds at 10 Hz from 7 s on: heading east at 1 m/s, 5 m deep, rolled by 5 deg.

    `events` are times [s] and numbers of EV, `status` is the estimator's, `without` leaves kinds
    of messages out.
    """
    log = Dataflash()
    log.describe(10, "ATT", "Qffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    log.describe(11, "XKF1", "QBfffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD")
    log.describe(12, "IMU", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ")
    channels = ",".join(f"C{i}" for i in range(1, 15))
    log.describe(13, "RCOU", "Q" + "H" * 14, f"TimeUS,{channels}")
    log.describe(14, "BAT", "QBf", "TimeUS,Inst,Volt")
    log.describe(15, "PARM", "QNf", "TimeUS,Name,Value")
    log.describe(16, "MSG", "QZ", "TimeUS,Message")
    log.describe(17, "EV", "QB", "TimeUS,Id")
    log.describe(18, "XKF4", "QBI", "TimeUS,C,SS")
    log.describe(19, "RFND", "QCBB", "TimeUS,Dist,Stat,Orient")
    log.describe(20, "VISO", "Qfffffff", "TimeUS,dt,AngDX,PosDX,PosDY,PosDZ,conf,x")
    if firmware:
        log.put("MSG", 6_900_000, firmware.encode())
    for name, value in settings.items():
        log.put("PARM", 6_900_000, name.encode(), value)

    def put(name: str, *values: Any) -> None:
        if name not in without:
            log.put(name, *values)

    pending = list(events)
    outputs = (*(*pwm, *([0] * 12))[:12], 1900, 1900)  # lights are bright
    for k in range(samples):
        us = 7_000_000 + 100_000 * k
        while pending and pending[0][0] * 1e6 <= us:
            at, number = pending.pop(0)
            log.put("EV", round(at * 1e6), number)
        put("RCOU", us, *outputs)
        put("ATT", us + 20_000, 0, 5.0, 0, 0.0, 0, 90.0)
        for core in (0, 1):
            put("XKF1", us + 20_000, core, 5.0, 0, 90, 0, 1.0 + core, 0, 1.0, 0.1 * k, depth)
        put("IMU", us + 40_000, 0, 0.01, 0.02, 0.03)
        put("IMU", us + 40_000, 1, 9, 9, 9)
        put("BAT", us, 0, 15.8)
        put("BAT", us, 1, 5.0)
        if status is not None:
            put("XKF4", us, 0, status)
    path.write_bytes(log.data)
    return path


def tlog(
    path: Path,
    settings: Mapping[str, float] = ROV,
    *,
    kinds: Sequence[str] = ("ATTITUDE", "LOCAL", "SERVO", "SYS", "BEAT"),
    kind: int = 12,
    systems: Sequence[int] = (1,),
    armed: bool = True,
    start: int = 5000,
) -> Path:
    """Write six seconds at 10 Hz: heading east at 1 m/s, 5 m deep, as an autopilot sends them."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    with path.open("ab") as file:

        def write(link: Any, ms: int, message: Any) -> None:
            file.write(struct.pack(">Q", 1_700_000_000_000_000 + ms * 1000))
            file.write(message.pack(link))

        for system in systems:
            link: Any = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
            for n, (name, value) in enumerate(settings.items()):
                write(link, start, link.param_value_encode(name.encode(), value, 9, 99, n))
        for k in range(60):
            ms = start + 100 * k
            for system in systems:
                link = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
                messages = {
                    "SERVO": link.servo_output_raw_encode(ms * 1000, 0, *PWM, 0, 0),
                    "ATTITUDE": link.attitude_encode(ms, 0.1, 0.0, pi / 2, 0.01, 0.02, 0.03),
                    "LOCAL": link.local_position_ned_encode(ms, 1.0, 0.1 * k, 5.0, 0.0, 1.0, 0.0),
                    "SYS": link.sys_status_encode(0, 0, 0, 0, 15800, 100, 90, 0, 0, 0, 0, 0, 0),
                    "BEAT": link.heartbeat_encode(kind, 3, 128 if armed else 0, 0, 4, 3),
                }
                for name in kinds:
                    write(link, ms, messages[name])
            # A companion computer has a clock of its own.
            link = mavlink.MAVLink(None, srcSystem=systems[0], srcComponent=194)
            write(link, ms, link.distance_sensor_encode(99, 20, 5000, 400, 0, 1, 25, 0))
    return path
