"""Telemetry logs (.tlog) of ArduSub as a vehicle log.

Each record is a time of eight bytes [us, big-endian] and a MAVLink packet, version 1 or 2. Packets
are found by their lengths; only those that are needed are decoded, by pymavlink, with their
checksums.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.vehicle_log import (
    Series,
    VehicleLog,
    check_firmware,
    with_depth,
    without_repetitions,
)

__all__ = ["read_telemetry"]

Array = NDArray[np.float64]
_AIDED, _UNAIDED = 1 << 3 | 1 << 4, 1 << 7  # EKF_STATUS_REPORT: horizontal position; none
_NO_AUTOPILOT, _ARDUPILOT, _SUBMARINE = 8, 3, 12
_ARMED = 128
_WRAP = 2**32 / 1e6  # s after which the time of SERVO_OUTPUT_RAW begins again
_DOWN = 25
_AUTOPILOT, _ODOMETRY = 1, 11011  # component; VISION_POSITION_DELTA


def read_telemetry(path: Path) -> VehicleLog:
    """Read a .tlog; raises InputInvalid for one of another vehicle, or of two."""
    try:
        from pymavlink.dialects.v20 import ardupilotmega as dialect
    except ImportError:
        raise InputInvalid(
            path, "telemetry logs are decoded by pymavlink", "`pip install 'uuvsim-cosim[mavlink]'`"
        ) from None
    data = path.read_bytes()
    if data[8:9] not in (b"\xfe", b"\xfd"):
        raise InputInvalid(
            path, f"begins with {data[:9].hex(' ') or 'nothing'}", "a telemetry log of MAVLink"
        )
    mavlink: Any = dialect
    link: Any = mavlink.MAVLink(None)
    reader = _Telemetry(path)
    names = {number: kind.msgname for number, kind in mavlink.mavlink_map.items()}
    for place, size, kind in reader.packets(data):
        name = names.get(kind, "")
        reader.names.add(name or str(kind))
        if name not in _READ:
            continue
        try:
            message = link.decode(bytearray(data[place : place + size]))
        except mavlink.MAVError:
            reader.damaged += 1
            continue
        reader.take(name, message, int.from_bytes(data[place - 8 : place], "big") * 1e-6)
    return reader.log()


class _Telemetry:
    """Rows of each quantity, of the one autopilot in the log."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: dict[str, list[tuple[float, ...]]] = {}
        self.parameters: dict[str, float] = {}
        self.kinds: dict[int, int] = {}  # type of vehicle by system
        self.talking: set[int] = set()  # systems that sent an attitude
        self.names: set[str] = set()
        self.status, self.time = _AIDED, 0.0
        self.damaged = self.lost = self.cut = 0

    def packets(self, data: bytes) -> Iterator[tuple[int, int, int]]:
        """Yield place, size and kind of each packet; bytes between packets are counted.

        Of components beside the autopilot, only displacements of a DVL: other clocks are theirs.
        """
        i, end = 0, len(data)
        while i + 20 <= end:
            start = data[i + 8]
            if start == 0xFD:
                size = 12 + data[i + 9] + (13 if data[i + 10] & 1 else 0)
                component = data[i + 14]
                kind = int.from_bytes(data[i + 15 : i + 18], "little")
            elif start == 0xFE:
                size, component, kind = 8 + data[i + 9], data[i + 12], data[i + 13]
            else:
                i += 1
                self.lost += 1
                continue
            if i + 8 + size > end:
                break
            if component == _AUTOPILOT or kind == _ODOMETRY:
                yield i + 8, size, kind
            i += 8 + size
        self.cut = end - i

    def take(self, name: str, m: Any, received: float) -> None:
        """Add a message to the rows of what it measures."""
        if name == "HEARTBEAT":
            if m.autopilot != _NO_AUTOPILOT:
                self.kinds[m.get_srcSystem()] = m.type if m.autopilot == _ARDUPILOT else -1
                self._put("armed", self.time or np.nan, float(bool(m.base_mode & _ARMED)))
            return
        if name == "PARAM_VALUE":
            self.parameters[m.param_id.rstrip("\0")] = float(m.param_value)
            return
        _READ[name](self, m, received)

    def log(self) -> VehicleLog:
        """Return the log; refuses two vehicles, and others than submarines."""
        systems = sorted(self.kinds or self.talking)
        if len(systems) > 1:
            raise InputInvalid(
                self.path,
                f"messages of {len(systems)} vehicles (systems {', '.join(map(str, systems))})",
                "a log of one vehicle",
            )
        for kind in self.kinds.values():
            if kind not in (_SUBMARINE, 0):
                what = "another autopilot than ArduPilot" if kind < 0 else f"vehicle type {kind}"
                raise InputInvalid(
                    self.path, f"a log of {what}", f"a submarine (type {_SUBMARINE}) with ArduSub"
                )
        check_firmware(self.path, "", self.parameters)
        series = {}
        for name, rows in self.rows.items():
            table = np.array(rows, dtype=float)
            table = table[np.isfinite(table[:, 0])]
            if not len(table):
                continue
            t = table[:, 0]
            if name == "pwm":
                t = t + _WRAP * np.cumsum(np.concatenate([[0.0], np.diff(t) < -0.5 * _WRAP]))
            series[name] = without_repetitions(self.path, _SOURCE[name], t, table[:, 1:])
        if "armed" in series:  # as at the first heartbeat
            armed = series["armed"]
            t = np.concatenate([[-np.inf], armed.t])
            series["armed"] = Series(t, np.concatenate([armed.values[:1], armed.values]))
        remarks = []
        if self.damaged or self.lost:
            remarks.append(
                f"{self.damaged} packets with wrong checksums and {self.lost} bytes between "
                "packets are left out"
            )
        if self.cut:
            remarks.append(f"the log ends within a packet: its last {self.cut} bytes are left out")
        return VehicleLog(self.path, with_depth(series), self.parameters, "", tuple(remarks))

    def _put(self, name: str, t: float, *values: float) -> None:
        self.rows.setdefault(name, []).append((t, *values))

    # ---- what each message measures -----------------------------------------------------------

    def _attitude(self, m: Any, received: float) -> None:
        self.time = m.time_boot_ms * 1e-3
        self.talking.add(m.get_srcSystem())
        self._put("attitude", self.time, m.roll, m.pitch, m.yaw)
        self._put("rates", self.time, m.rollspeed, m.pitchspeed, m.yawspeed)

    def _local_position(self, m: Any, received: float) -> None:
        lost = self.status & _AIDED == 0 or self.status & _UNAIDED
        n, e, v_n, v_e = (np.nan,) * 4 if lost else (m.x, m.y, m.vx, m.vy)
        self._put("position", m.time_boot_ms * 1e-3, n, e, m.z)
        self._put("velocity", m.time_boot_ms * 1e-3, v_n, v_e, m.vz)

    def _global_position(self, m: Any, received: float) -> None:
        self._put("depth", m.time_boot_ms * 1e-3, -m.relative_alt * 1e-3)

    def _servos(self, m: Any, received: float) -> None:
        if m.port == 0:
            pulses = (float(getattr(m, f"servo{i}_raw", 0) or 0) for i in range(1, 17))
            self._put("pwm", m.time_usec * 1e-6, *pulses)

    def _supply(self, m: Any, received: float) -> None:
        if self.time and m.voltage_battery < 65535:
            self._put("voltage", self.time, m.voltage_battery * 1e-3)

    def _range(self, m: Any, received: float) -> None:
        within = m.min_distance < m.current_distance < m.max_distance
        if m.orientation == _DOWN and within and m.time_boot_ms:
            self._put("range", m.time_boot_ms * 1e-3, m.current_distance * 1e-2)

    def _odometry(self, m: Any, received: float) -> None:
        if m.confidence > 0 and m.time_delta_usec > 0 and self.time:
            dt = m.time_delta_usec * 1e-6
            self._put("dvl", self.time - 0.5 * dt, *(d / dt for d in m.position_delta))

    def _estimator(self, m: Any, received: float) -> None:
        self.status = int(m.flags)


_READ: dict[str, Any] = {
    "HEARTBEAT": None, "PARAM_VALUE": None, "ATTITUDE": _Telemetry._attitude,
    "LOCAL_POSITION_NED": _Telemetry._local_position,
    "GLOBAL_POSITION_INT": _Telemetry._global_position,
    "SERVO_OUTPUT_RAW": _Telemetry._servos, "SYS_STATUS": _Telemetry._supply,
    "DISTANCE_SENSOR": _Telemetry._range, "VISION_POSITION_DELTA": _Telemetry._odometry,
    "EKF_STATUS_REPORT": _Telemetry._estimator,
}  # fmt: skip
_SOURCE = {
    "armed": "ATTITUDE", "attitude": "ATTITUDE", "rates": "ATTITUDE", "pwm": "SERVO_OUTPUT_RAW",
    "position": "LOCAL_POSITION_NED", "velocity": "LOCAL_POSITION_NED", "voltage": "SYS_STATUS",
    "depth": "GLOBAL_POSITION_INT", "range": "DISTANCE_SENSOR", "dvl": "VISION_POSITION_DELTA",
}  # fmt: skip
