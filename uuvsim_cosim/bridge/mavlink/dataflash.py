"""DataFlash logs (.BIN) as ArduPilot writes them: each message's layout comes first, in FMT.

Names, columns, units and multipliers are those of ArduSub's messages that pymavlink's DFReader and
`uuvsim identify` read. All numbers are little-endian; each message begins with A3 95 and its type.
"""

from __future__ import annotations

import struct
from math import degrees
from typing import final

from uuvsim_cosim.bridge.mavlink.vehicle import State

__all__ = ["DataFlashLog"]

_SIZES = {"Q": "Q", "B": "B", "b": "b", "H": "H", "f": "f", "d": "d", "M": "B",
          "n": "4s", "N": "16s", "Z": "64s"}  # fmt: skip
# Name: type, format, columns, units, multipliers (one letter for each column).
_LAYOUTS = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    "UNIT": (130, "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    "MULT": (131, "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    "FMTU": (129, "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    "MSG": (132, "QZ", "TimeUS,Message", "s-", "F-"),
    "PARM": (133, "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    "MODE": (134, "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
    "ATT": (135, "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF", "sddddhh-",
            "F000000-"),
    "IMU": (136, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", "s#EEEooo", "F-000000"),
    "BARO": (137, "QBfff", "TimeUS,I,Alt,Press,Temp", "s#mPO", "F-000"),
    "CTUN": (138, "Qff", "TimeUS,DAlt,Alt", "smm", "F00"),
    "RCOU": (139, "Q" + "H" * 14, "TimeUS," + ",".join(f"C{i}" for i in range(1, 15)),
             "s" + "Y" * 14, "F" + "-" * 14),
    "BAT": (140, "QBfff", "TimeUS,Inst,Volt,Curr,RemPct", "s#vA%", "F-000"),
    "XKF1": (141, "QBfffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,PN,PE,PD", "s#ddhnnnmmm",
             "F-000000000"),
}  # fmt: skip
_UNITS = {"-": "", "s": "s", "d": "deg", "h": "degheading", "E": "rad/s", "o": "m/s/s", "m": "m",
          "P": "Pa", "O": "degC", "Y": "us", "v": "V", "A": "A", "%": "%", "n": "m/s",
          "#": "instance", "b": "B"}  # fmt: skip
_MULTIPLIERS = {"-": 0.0, "0": 1.0, "F": 1e-6}
_LARGEST = 1 << 28  # bytes of one log; later messages are left out


@final
class DataFlashLog:
    """A log in memory; `data` is the content of its file.

    Example:

    >>> from uuvsim_cosim.bridge.mavlink.dataflash import DataFlashLog
    >>> bytes(DataFlashLog({"SYSID_THISMAV": 1.0}).data[:3]).hex()
    'a39580'
    """

    def __init__(self, parameters: dict[str, float], time: float = 0.0) -> None:
        self.data = bytearray()
        at = round(time * 1e6)
        for name, (kind, format_, columns, _, _) in _LAYOUTS.items():
            size = 3 + struct.calcsize("<" + "".join(_SIZES[c] for c in format_))
            self.write("FMT", kind, size, name, format_, columns)
        for letter, unit in _UNITS.items():
            self.write("UNIT", at, ord(letter), unit)
        for letter, factor in _MULTIPLIERS.items():
            self.write("MULT", at, ord(letter), factor)
        for kind, _, _, units, multipliers in _LAYOUTS.values():
            self.write("FMTU", at, kind, units, multipliers)
        self.write("MSG", at, "ArduSub, simulated by uuvsim-cosim")
        for name, value in parameters.items():
            self.write("PARM", at, name[:16], value, value)

    def write(self, name: str, *values: object) -> None:
        """Append a message."""
        kind, format_, *_ = _LAYOUTS[name]
        if len(self.data) > _LARGEST:
            return
        packed = [v.encode() if isinstance(v, str) else v for v in values]
        self.data += b"\xa3\x95" + bytes([kind])
        self.data += struct.pack("<" + "".join(_SIZES[c] for c in format_), *packed)

    def sample(self, s: State, desired: tuple[float, float, float, float]) -> None:
        """Append a state; `desired` are north, east, down [m] and heading [rad]."""
        at = round(s.time * 1e6)
        roll, pitch, yaw = (degrees(x) for x in s.eta[3:])
        yaw %= 360.0
        rates = s.gyro if s.gyro is not None else s.nu[3:]
        depth = s.eta[2]
        self.write("ATT", at, 0.0, roll, 0.0, pitch, degrees(desired[3]) % 360.0, yaw, 3)
        self.write("IMU", at, 0, *rates, *s.specific_force)
        self.write("BARO", at, 0, -depth, s.absolute_pressure, 0.0)
        self.write("CTUN", at, -desired[2], -depth)
        self.write("XKF1", at, 0, roll, pitch, yaw, *s.velocity, *s.eta[:3])
        self.write("RCOU", at, *(*s.pwm, *([0] * 14))[:14])
        if s.voltage is not None:
            percent = -1.0 if s.state_of_charge is None else 100.0 * s.state_of_charge
            self.write("BAT", at, 0, s.voltage, s.current_total or 0.0, percent)
