"""MAVLink to an autopilot: commands, pilot input, and aiding by DVL and USBL."""

from __future__ import annotations

import contextlib
import logging
import math
import select
import socket
from collections import Counter
from collections.abc import Sequence
from typing import Any, final

from uuvsim_cosim.bridge.autopilots.sitl_process import HOME
from uuvsim_cosim.errors import InputInvalid

__all__ = ["GUIDED", "AutopilotCommands"]

log = logging.getLogger("uuvsim_cosim.ardusub")
GUIDED = 4  # ArduSub's number of the mode
_NO_POSITION = 0b111  # bits of a target without a position
_POSITION_AND_YAW = 0b1001_1111_1000  # bits of the fields that are ignored: velocity, …, yaw rate
_AND_VELOCITY = 0b1001_1100_0000
_RADIUS = 6_378_100.0  # m, of ArduPilot's sphere
_FIXED_3D = 3
_GPS_IGNORE = 0b11_1000  # velocities, and their accuracy


@final
class AutopilotCommands:
    """Messages are collected with `send_…` and written by `flush`, before the tick's answer."""

    def __init__(
        self, connection: socket.socket, name: str = "ArduSub", system: int = 1, shift: int = 0
    ) -> None:
        """Speak MAVLink 2 over a `connection`; raises InputInvalid without pymavlink.

        `name` is the autopilot's in messages, `system` its number. The number of its mode begins at
        bit `shift` of its heartbeat's custom mode.
        """
        try:
            from pymavlink.dialects.v20 import ardupilotmega
        except ImportError:
            raise InputInvalid(
                name, "commands need pymavlink", "`pip install 'uuvsim-cosim[mavlink]'`"
            ) from None
        self._dialect = ardupilotmega
        self._mav = ardupilotmega.MAVLink(None, srcSystem=255, srcComponent=190)
        self._mav.robust_parsing = True
        connection.settimeout(1.0)
        self._connection = connection
        self._waiting = select.poll()
        self._waiting.register(connection, select.POLLIN)
        self._name, self._system, self._shift = name, system, shift
        self._bytes = bytearray()
        self.armed = False
        self.mode = -1
        self.target: tuple[float, float, float] | None = None  # N E D [m] of its own report
        self.reports = 0  # of its target
        self.texts: list[str] = []  # messages of the autopilot
        self.refused: Counter[tuple[Any, ...]] = Counter()  # by names of command and result

    def heartbeat(self) -> None:
        """Send that a ground station is there."""
        d = self._dialect
        self._add(d.MAVLink_heartbeat_message(d.MAV_TYPE_GCS, d.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3))

    def no_streams(self) -> None:
        """Stop the messages that the autopilot sends regularly, except its heartbeat."""
        self._add(self._dialect.MAVLink_request_data_stream_message(self._system, 1, 0, 0, 0))

    def report_target(self, period: float) -> None:
        """Ask for the autopilot's own target each `period` [s]."""
        d = self._dialect
        message = d.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT
        self._command(d.MAV_CMD_SET_MESSAGE_INTERVAL, float(message), 1e6 * period)

    def arm(self, armed: bool) -> None:
        """Arm or disarm."""
        self._command(self._dialect.MAV_CMD_COMPONENT_ARM_DISARM, float(armed))

    def change_mode(self, mode: int) -> None:
        """Change the mode, by the autopilot's number: PX4 calls it the main mode."""
        self._command(self._dialect.MAV_CMD_DO_SET_MODE, 1.0, float(mode))

    def manual(self, axes: Sequence[float]) -> None:
        """Send a pilot's axes: surge, sway, heave (down), roll, pitch, yaw, each from -1 to 1."""
        x, y, z, s, t, r = (round(1000 * max(-1.0, min(1.0, a))) for a in axes)
        extensions = 0b11  # pitch and roll are given
        self._add(
            self._dialect.MAVLink_manual_control_message(
                self._system, x, y, 500 - z // 2, r, 0, 0, extensions, t, s, 0, 0, 0, 0, 0, 0
            )
        )

    def position(
        self, time: float, eta_d: Sequence[float], nu_d: Sequence[float] | None = None
    ) -> tuple[float, float, float]:
        """Send a desired position N, E, D [m] and yaw [rad]; return the velocity N, E, D [m/s].

        With a velocity `nu_d` of the desired pose, in its own level axes, the pose is a target that
        moves. ArduSub follows it; without a velocity, it plans a path to the position and stops.
        """
        n, e, d, _, _, psi = eta_d
        u, v, w = (0.0, 0.0, 0.0) if nu_d is None else nu_d[:3]
        north, east = u * math.cos(psi) - v * math.sin(psi), u * math.sin(psi) + v * math.cos(psi)
        self._add(
            self._dialect.MAVLink_set_position_target_local_ned_message(
                round(1e3 * time) % 2**32, self._system, 1, self._dialect.MAV_FRAME_LOCAL_NED,
                _POSITION_AND_YAW if nu_d is None else _AND_VELOCITY,
                n, e, d, north, east, w, 0, 0, 0, psi, 0,
            )
        )  # fmt: skip
        return north, east, w

    def moved(
        self, time: float, period: float, turned: Sequence[float], moved: Sequence[float]
    ) -> None:
        """Send how far the vehicle turned [rad] and moved [m], in b, in a `period` [s] (DVL)."""
        self._add(
            self._dialect.MAVLink_vision_position_delta_message(
                round(1e6 * time), round(1e6 * period), list(turned), list(moved), 100.0
            )
        )

    def fix(self, time: float, position: Sequence[float], sigma: float) -> None:
        """Send a position N, E, D [m] with its standard deviation [m] as a GPS's."""
        n, e, d = position
        latitude = HOME[0] + math.degrees(n / _RADIUS)
        longitude = HOME[1] + math.degrees(e / _RADIUS / math.cos(math.radians(HOME[0])))
        self._add(
            self._dialect.MAVLink_gps_input_message(
                round(1e6 * time), 0, _GPS_IGNORE, round(1e3 * time), 2300,
                _FIXED_3D, round(1e7 * latitude), round(1e7 * longitude), -d, 1.0, 1.0, 0, 0, 0,
                0.0, sigma, 2.0 * sigma, 12, 0,
            )
        )  # fmt: skip

    def flush(self) -> None:
        """Write the collected messages."""
        if self._bytes:
            with contextlib.suppress(ConnectionRefusedError):  # UDP: nobody listens there yet
                self._connection.sendall(self._bytes)
            self._bytes.clear()

    def read(self) -> None:
        """Read all messages that the autopilot has sent."""
        with contextlib.suppress(ConnectionRefusedError):
            while self._waiting.poll(0) and (data := self._connection.recv(65_536)):
                for message in self._mav.parse_buffer(data) or ():
                    self._note(message)

    def close(self) -> None:
        """Close the connection."""
        self._connection.close()

    # ---- inside ---------------------------------------------------------------------------

    def _note(self, message: Any) -> None:
        kind = message.get_type()
        self.reports += kind.startswith("POSITION_TARGET")
        if kind == "HEARTBEAT" and message.get_srcComponent() == 1:
            self.armed = bool(message.base_mode & self._dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            self.mode = (int(message.custom_mode) >> self._shift) & 0xFF
        elif kind == "POSITION_TARGET_GLOBAL_INT":
            n = math.radians(1e-7 * message.lat_int - HOME[0]) * _RADIUS
            e = math.radians(1e-7 * message.lon_int - HOME[1]) * _RADIUS
            self.target = (n, e * math.cos(math.radians(HOME[0])), -message.alt)
        elif kind == "POSITION_TARGET_LOCAL_NED":
            given = not message.type_mask & _NO_POSITION
            self.target = (message.x, message.y, message.z) if given else None
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
            log.info("%s: %s", self._name, message.text)
        elif kind == "COMMAND_ACK" and message.result != 0:
            refusal = tuple(
                kinds[number].name if (kinds := self._dialect.enums[enum]).get(number) else number
                for enum, number in (("MAV_CMD", message.command), ("MAV_RESULT", message.result))
            )
            self.refused[refusal] += 1
            log.warning("%s refused %s (%s)", self._name, *refusal)

    def _command(self, command: int, *values: float) -> None:
        padded = [*values, *[0.0] * (7 - len(values))]
        self._add(self._dialect.MAVLink_command_long_message(self._system, 1, command, 0, *padded))

    def _add(self, message: Any) -> None:
        self._bytes += message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
