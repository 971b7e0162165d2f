"""Services of a vehicle over MAVLink: commands, parameters, manual control, set-points, logs.

The pilot (`keyboard`) moves the vehicle. Its four axes come from MANUAL_CONTROL, or from a
set-point or waypoint, as proportional guidance: v = K (p_d - p), limited to the pilot's speeds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, cos, hypot, isfinite, nan, sin
from time import monotonic
from typing import Any, final

from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.http.manual_axes import AXES, SetPoint, manual_axes_of, pilots
from uuvsim_cosim.bridge.mavlink.dataflash import DataFlashLog
from uuvsim_cosim.bridge.mavlink.missions import WAYPOINT, Missions
from uuvsim_cosim.bridge.mavlink.vehicle import (
    ORIGIN,
    State,
    Vehicle,
    global_of,
    local_of,
    messages_of,
    wrapped,
)
from uuvsim_cosim.errors import UuvsimError

__all__ = ["Services"]

MODES = {0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 9: "SURFACE", 16: "POSHOLD",
         19: "MANUAL"}  # fmt: skip
_MANUAL = (0, 2, 16, 19)
_K, _K_PSI = 0.5, 1.0  # [1/s] of position and heading
_MANUAL_LASTS, _GUIDED_LASTS = 0.5, 3.0  # [s] of manual control, of a velocity set-point
_REACHED = 1.0  # [m] from a waypoint that gives no acceptance radius
_LOGS = 64  # that are kept; the oldest one is dropped
_CHUNK, _CHUNKS = 90, 100  # bytes of LOG_DATA; messages sent in one turn
_RATES = {  # [Hz] at the start
    "HEARTBEAT": 1.0, "ATTITUDE": 10.0, "LOCAL_POSITION_NED": 10.0, "GLOBAL_POSITION_INT": 5.0,
    "GPS_RAW_INT": 2.0, "SYS_STATUS": 2.0, "SCALED_PRESSURE2": 2.0, "VFR_HUD": 4.0,
    "SERVO_OUTPUT_RAW": 4.0, "RAW_IMU": 4.0, "BATTERY_STATUS": 1.0, "SYSTEM_TIME": 1.0,
    "RANGEFINDER": 2.0, "DISTANCE_SENSOR": 2.0, "MISSION_CURRENT": 1.0, "HOME_POSITION": 0.2,
}  # fmt: skip


@final
class Services:
    """The services of one vehicle; `send(message, peer)` sends, to all peers if peer is None.

    A log is sent only while the peer has room (`has_room`): one that reads slowly gets it slowly.
    """

    def __init__(
        self,
        service: Service,
        client: Client,
        vehicle: Vehicle,
        system_id: int,
        mav: Any,
        send: Callable[[Any, Any], None],
        has_room: Callable[[Any], bool] = lambda peer: True,
    ) -> None:
        self._service, self._client, self._vehicle, self._mav = service, client, vehicle, mav
        self._id, self._send, self._has_room = system_id, send, has_room
        self._ids = {mav.mavlink_map[i].msgname: i for i in mav.mavlink_map}
        self.state: State = vehicle.read(service, client)
        self.missions = Missions(mav, send)
        self.armed, self.mode, self.origin = False, 2, ORIGIN
        self.log: DataFlashLog | None = None
        self.logs: list[DataFlashLog] = []
        fit = [p["component"] for p in pilots(service)["pilots"]  # type: ignore[attr-defined]
               if vehicle.owns(p["component"])]  # fmt: skip
        self.pilot: str | None = fit[0] if fit else None
        self._parameters = self._tunable()
        limits = [f"{self.pilot}.{axis}_max" for axis in AXES]
        known = {i.name for i in service.schema()}
        self._limits = [1.0] * 4
        if self.pilot is not None and set(limits) <= known:
            values = service.get(client, limits)
            self._limits = [float(values[name]) for name in limits]
        self._due = {name: (1.0 / rate, 0.0) for name, rate in _RATES.items()}
        self._axes, self._axes_at = (0.0, 0.0, 0.0, 0.0), -1e9
        self._target: tuple[float, float, float, float] | None = None  # N E D [m], psi [rad]
        self._velocity: tuple[float, float, float, float] | None = None  # NED [m/s], r [rad/s]
        self._velocity_at = -1e9
        self._held_since: float | None = None  # at a waypoint [s]
        self._download: list[Any] | None = None  # peer, log, offset, end

    def set_mission(self, points: Sequence[Sequence[float]]) -> None:
        """Make waypoints (n, 3), north, east, down [m], the mission; item 0 is the origin."""
        make = self._mav.MAVLink_mission_item_int_message
        rows = enumerate([(0.0, 0.0, 0.0), *points])
        self.missions.items = [
            make(0, 0, i, 3, WAYPOINT, 0, 1, 0.0, 0.0, 0.0, nan,
                 *(round(x * 1e7) for x in global_of(n, e, self.origin)), -d, 0)
            for i, (n, e, d) in rows
        ]  # fmt: skip

    # ---- every turn -----------------------------------------------------------------------

    def turn(self) -> None:
        """Read the state, steer the pilot, write the log, and send the messages that are due."""
        before = self.state.time
        self.state = self._vehicle.read(self._service, self._client)
        if self.state.time < before and self.log is not None:  # after a reset
            self.log = None
        self._steer()
        if self.log is not None and self.state.time > before:
            self.log.sample(self.state, self._target or self._place())
        now = monotonic()
        due = [n for n, (interval, at) in self._due.items() if interval > 0 and now >= at]
        if due:
            known = self._messages()
            for name in due:
                self._due[name] = (self._due[name][0], now + self._due[name][0])
                message = known.get(name) or self._other(name)
                if message is not None:
                    self._send(message, None)
        self.missions.poll()
        self._send_log()

    @property
    def is_busy(self) -> bool:
        """Whether a log is being sent."""
        return self._download is not None

    def _messages(self) -> dict[str, Any]:
        return messages_of(self._mav, self.state, self.origin, can_arm=self.pilot is not None)

    def _other(self, name: str) -> Any:
        mav, s = self._mav, self.state
        if name == "HEARTBEAT":
            base = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            base |= mav.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
            base |= mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED if self.mode in _MANUAL else 0
            status = mav.MAV_STATE_ACTIVE if self.armed else mav.MAV_STATE_STANDBY
            return mav.MAVLink_heartbeat_message(
                mav.MAV_TYPE_SUBMARINE, mav.MAV_AUTOPILOT_ARDUPILOTMEGA, base, self.mode, status, 3
            )
        if name == "MISSION_CURRENT":
            return self.missions.status()
        lat, lon = (round(x * 1e7) for x in self.origin)
        if name == "HOME_POSITION":
            return mav.MAVLink_home_position_message(
                lat, lon, 0, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], nan, nan, nan
            )
        if name == "GPS_GLOBAL_ORIGIN":
            return mav.MAVLink_gps_global_origin_message(lat, lon, 0, round(s.time * 1e6))
        if name == "AUTOPILOT_VERSION":
            can = (
                mav.MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
                | mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT
                | mav.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
                | mav.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
                | mav.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
                | mav.MAV_PROTOCOL_CAPABILITY_MAVLINK2
            )
            zeros = [0] * 8
            version = 4 << 24 | 5 << 16 | 255
            return mav.MAVLink_autopilot_version_message(
                can, version, 0, 0, 0, zeros, zeros, zeros, 0, 0, self._id
            )
        return None

    # ---- messages that arrive -------------------------------------------------------------

    def handle(self, m: Any, peer: Any) -> None:
        """Answer a message; one for another vehicle, or that is unknown, is ignored."""
        name = m.get_type()
        if getattr(m, "target_system", 0) not in (0, self._id):
            return
        if getattr(m, "target_component", 0) not in (0, 1):
            return
        if self.missions.handle(name, m, peer):
            return
        answer = getattr(self, f"_on_{name.lower()}", None)
        if answer is not None:
            answer(m, peer)

    def _on_command_long(self, m: Any, peer: Any) -> None:
        values = [m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7]
        self._command(m, values, peer)

    def _on_command_int(self, m: Any, peer: Any) -> None:
        self._command(m, [m.param1, m.param2, m.param3, m.param4, m.x, m.y, m.z], peer)

    def _command(self, m: Any, values: list[float], peer: Any) -> None:
        mav = self._mav
        p = [v if isfinite(v) else 0.0 for v in values]
        sent: list[Any] = []
        if m.command in (
            mav.MAV_CMD_COMPONENT_ARM_DISARM,
            mav.MAV_CMD_DO_SET_MODE,
        ) and not isfinite(values[0]):
            result = mav.MAV_RESULT_DENIED
        else:
            result = self._result(m.command, p, sent)
        ack = mav.MAVLink_command_ack_message(
            m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
        )
        self._send(ack, peer)
        for message in sent:
            self._send(message, peer)

    def _result(self, command: int, p: list[float], sent: list[Any]) -> Any:
        """Carry out a command; return its MAV_RESULT."""
        mav = self._mav
        good, denied = mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_DENIED
        if command == mav.MAV_CMD_COMPONENT_ARM_DISARM:
            return good if self._arm(p[0] >= 0.5) else denied
        if command == mav.MAV_CMD_DO_SET_MODE:
            return good if self._set_mode(int(p[1])) else denied
        if command == mav.MAV_CMD_MISSION_START:
            if not self.armed or not self.missions.items:
                return denied
            self.missions.set_current(int(p[0]))
            return good if self._set_mode(3) else denied
        if command == mav.MAV_CMD_DO_SET_MISSION_CURRENT:
            return good if self.missions.set_current(int(p[0])) else denied
        if command in (mav.MAV_CMD_REQUEST_MESSAGE, mav.MAV_CMD_SET_MESSAGE_INTERVAL,
                       mav.MAV_CMD_GET_MESSAGE_INTERVAL):  # fmt: skip
            name = self._named(int(p[0]))
            if name is None:
                return mav.MAV_RESULT_UNSUPPORTED
            if command == mav.MAV_CMD_REQUEST_MESSAGE:
                sent.append(self._messages().get(name) or self._other(name))
            elif command == mav.MAV_CMD_SET_MESSAGE_INTERVAL:
                default = 1.0 / _RATES.get(name, 1.0)
                interval = default if p[1] == 0 else max(p[1] / 1e6, -1.0)
                self._due[name] = (max(interval, 0.01) if interval > 0 else -1.0, 0.0)
            else:
                interval = self._due.get(name, (-1.0, 0.0))[0]
                us = round(interval * 1e6) if interval > 0 else -1
                sent.append(mav.MAVLink_message_interval_message(int(p[0]), us))
            return good
        extra = {mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: "AUTOPILOT_VERSION",
                 mav.MAV_CMD_GET_HOME_POSITION: "HOME_POSITION"}  # fmt: skip
        if command in extra:
            sent.append(self._other(extra[command]))
            return good
        return mav.MAV_RESULT_UNSUPPORTED

    def _named(self, number: int) -> str | None:
        """Return the name of a message that this vehicle can send."""
        sent = {**self._messages(), **_RATES}
        own = (*sent, "GPS_GLOBAL_ORIGIN", "AUTOPILOT_VERSION")
        kind = self._mav.mavlink_map.get(number)
        name = None if kind is None else str(kind.msgname)
        if name in ("RANGEFINDER", "DISTANCE_SENSOR") and self.state.altitude is None:
            return None
        return name if name in own else None

    def _arm(self, on: bool) -> bool:
        if on and self.pilot is None:
            self.report("nothing steers: serve with --replace pilot=keyboard")
            return False
        if on and not self.armed:
            self.log = DataFlashLog(self._values(), self.state.time)
            self.log.write("MODE", round(self.state.time * 1e6), self.mode, self.mode, 1)
            self.logs.append(self.log)
            if len(self.logs) > _LOGS:
                del self.logs[0]
                self._download = None
        elif not on:
            self.log = None
        self.armed = on
        return True

    def _set_mode(self, mode: int) -> bool:
        if mode not in MODES or (self.pilot is None and mode in (3, 4, 9)):
            return False
        if mode != self.mode:
            self.mode = mode
            self._target = self._velocity = self._held_since = None
            if self.log is not None:
                self.log.write("MODE", round(self.state.time * 1e6), mode, mode, 2)
        return True

    def _on_set_mode(self, m: Any, peer: Any) -> None:
        self._set_mode(m.custom_mode)

    def _on_manual_control(self, m: Any, peer: Any) -> None:
        if m.target not in (0, self._id):
            return
        x, y, z, r = (0 if v == 32767 else max(-1000, min(1000, v)) for v in (m.x, m.y, m.z, m.r))
        heave = 0.0 if m.z == 32767 else -(z - 500) / 500.0
        self._axes, self._axes_at = (x / 1e3, y / 1e3, heave, r / 1e3), monotonic()

    def _on_set_position_target_local_ned(self, m: Any, peer: Any) -> None:
        if self.mode != 4 or m.coordinate_frame not in (1, 7, 8, 9):
            return
        s, mask = self.state, m.type_mask
        body = m.coordinate_frame in (8, 9)
        psi = s.eta[5]

        def turned(x: float, y: float) -> tuple[float, float]:
            c, k = (cos(psi), sin(psi)) if body else (1.0, 0.0)
            return c * x - k * y, k * x + c * y

        yaw = m.yaw + (psi if body else 0.0) if not mask & 1024 else psi
        rate = m.yaw_rate if not mask & 2048 else 0.0
        if not mask & 7:
            n, e = turned(m.x, m.y)
            start = (0.0, 0.0, 0.0) if m.coordinate_frame == 1 else s.eta[:3]
            target = (start[0] + n, start[1] + e, start[2] + m.z, yaw)
            if all(map(isfinite, target)):
                self._target, self._velocity = target, None
        elif not mask & 56:
            vn, ve = turned(m.vx, m.vy)
            velocity = (vn, ve, m.vz, rate)
            if all(map(isfinite, velocity)):
                self._target, self._velocity = None, velocity
                self._velocity_at = monotonic()

    def _on_set_attitude_target(self, m: Any, peer: Any) -> None:
        """Take heading and thrust (0.5: none, 1: up); the pilot keeps roll and pitch level."""
        w, x, y, z = m.q
        if self.mode != 4 or not all(map(isfinite, (*m.q, m.thrust))) or hypot(w, x, y, z) < 0.1:
            return
        psi = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        error = wrapped(psi - self.state.eta[5])
        up = max(-1.0, min(1.0, 2.0 * m.thrust - 1.0))
        self._target, self._velocity_at = None, monotonic()
        self._velocity = (0.0, 0.0, -up * self._limits[2], _K_PSI * error)

    def _on_set_gps_global_origin(self, m: Any, peer: Any) -> None:
        if abs(m.latitude) < 89e7 and abs(m.longitude) <= 180e7:
            self.origin = (m.latitude / 1e7, m.longitude / 1e7)
            self._send(self._other("GPS_GLOBAL_ORIGIN"), None)

    def _on_timesync(self, m: Any, peer: Any) -> None:
        if m.tc1 == 0:
            now = round(self._service.moment().time * 1e9)
            self._send(self._mav.MAVLink_timesync_message(now, m.ts1), peer)

    def _on_ping(self, m: Any, peer: Any) -> None:
        if m.target_system == 0:
            who = (m.get_srcSystem(), m.get_srcComponent())
            self._send(self._mav.MAVLink_ping_message(m.time_usec, m.seq, *who), peer)

    # ---- parameters -----------------------------------------------------------------------

    def _tunable(self) -> dict[str, str]:
        """Return the scalar tunable parameters by their name of at most 16 letters, if unique."""
        found: dict[str, list[str]] = {}
        prefix = self._vehicle.prefix
        for info in self._service.schema():
            scalar = info.type == "Float64" and not info.shape and info.settable
            owned = self._vehicle.owns(info.name.rpartition(".")[0])
            if scalar and info.causality == "parameter" and owned:
                short = info.name.removeprefix(prefix).replace(".", "_").upper()
                found.setdefault(short[:16], []).append(info.name)
        return {short: names[0] for short, names in sorted(found.items()) if len(names) == 1}

    def _values(self) -> dict[str, float]:
        values = self._service.get(self._client, list(self._parameters.values()))
        found = {short: float(values[name]) for short, name in self._parameters.items()}
        return {"SYSID_THISMAV": float(self._id), **_outputs(len(self.state.u)), **found}

    def _send_parameter(self, name: str, values: dict[str, float], peer: Any) -> None:
        number = list(values).index(name)
        kind = self._mav.MAV_PARAM_TYPE_REAL32
        self._send(
            self._mav.MAVLink_param_value_message(
                name.encode(), values[name], kind, len(values), number
            ),
            peer,
        )

    def _on_param_request_list(self, m: Any, peer: Any) -> None:
        values = self._values()
        for name in values:
            self._send_parameter(name, values, peer)

    def _on_param_request_read(self, m: Any, peer: Any) -> None:
        values = self._values()
        names = list(values)
        name = names[m.param_index] if 0 <= m.param_index < len(names) else m.param_id
        if m.param_index < len(names) and name in values:
            self._send_parameter(name, values, peer)

    def _on_param_set(self, m: Any, peer: Any) -> None:
        if m.param_id in self._parameters and isfinite(m.param_value):
            try:
                name = self._parameters[m.param_id]
                self._service.set(self._client, {name: m.param_value})
            except UuvsimError as error:
                self.report(str(error))
        values = self._values()
        if m.param_id in values:  # the old value, if the new one was refused
            self._send_parameter(m.param_id, values, peer)

    # ---- logs -----------------------------------------------------------------------------

    def _on_log_request_list(self, m: Any, peer: Any) -> None:
        mav, count = self._mav, len(self.logs)
        if not count:
            self._send(mav.MAVLink_log_entry_message(0, 0, 0, 0, 0), peer)
        for i in range(max(1, m.start), min(count, m.end) + 1):
            size = len(self.logs[i - 1].data)
            self._send(mav.MAVLink_log_entry_message(i, count, count, 0, size), peer)

    def _on_log_request_data(self, m: Any, peer: Any) -> None:
        if 1 <= m.id <= len(self.logs):
            end = min(m.ofs + m.count, len(self.logs[m.id - 1].data))
            self._download = [peer, m.id, m.ofs, end]

    def _on_log_request_end(self, m: Any, peer: Any) -> None:
        self._download = None

    def _on_log_erase(self, m: Any, peer: Any) -> None:
        self.logs = [] if self.log is None else [self.log]
        self._download = None

    def _send_log(self) -> None:
        for _ in range(_CHUNKS):
            if self._download is None or not self._has_room(self._download[0]):
                return
            peer, number, at, end = self._download
            part = bytes(self.logs[number - 1].data[at : min(at + _CHUNK, end)])
            padded = list(part.ljust(_CHUNK, b"\0"))
            self._send(self._mav.MAVLink_log_data_message(number, at, len(part), padded), peer)
            self._download = [peer, number, at + _CHUNK, end] if len(part) == _CHUNK else None

    # ---- steering -------------------------------------------------------------------------

    def _place(self) -> tuple[float, float, float, float]:
        """Return north, east, down [m] and heading [rad]."""
        n, e, d, _, _, psi = self.state.eta
        return n, e, d, psi

    def report(self, text: str) -> None:
        """Send a text to all peers."""
        self._send(self._mav.MAVLink_statustext_message(4, text.encode()[:50]), None)

    def _steer(self) -> None:
        """Set the pilot's axes; without a command they are zero and the vehicle keeps its place."""
        if self.pilot is None:
            return
        now, axes, setpoint = monotonic(), (0.0, 0.0, 0.0, 0.0), SetPoint(self.mode)
        if not self.armed:
            manual_axes_of(self.pilot).release(f"mavlink-{self._id}")
            return
        if self.mode in _MANUAL and now - self._axes_at < _MANUAL_LASTS:
            axes = self._axes
        if self.mode == 9:
            n, e, _, psi = self._place()
            self._target = (n, e, 0.0, psi)
        if self.mode == 3:
            self._follow_mission()
        if self.mode in (3, 4, 9):
            v = self._desired()
            if v is not None:
                setpoint = SetPoint(self.mode, self._target, None if self._target else v)
                c, k = cos(self.state.eta[5]), sin(self.state.eta[5])
                body = (c * v[0] + k * v[1], c * v[1] - k * v[0], v[2], v[3])
                x = [max(-1.0, min(1.0, a / m)) for a, m in zip(body, self._limits, strict=True)]
                axes = (x[0], x[1], x[2], x[3])
        manual_axes_of(self.pilot).update(
            f"mavlink-{self._id}", dict(zip(AXES, axes, strict=True)), setpoint
        )

    def _desired(self) -> tuple[float, float, float, float] | None:
        """Return the desired velocity in NED [m/s] and rate of turn [rad/s]."""
        if self._target is not None:
            n, e, d, psi = self._target
            eta = self.state.eta
            away = (_K * (n - eta[0]), _K * (e - eta[1]), _K * (d - eta[2]))
            return (*away, _K_PSI * wrapped(psi - eta[5]))
        if self._velocity is not None and monotonic() - self._velocity_at < _GUIDED_LASTS:
            return self._velocity
        return None

    def _follow_mission(self) -> None:
        """Make the current waypoint the target; the next one once it is reached and held."""
        missions, s = self.missions, self.state
        while missions.current < len(missions.items):
            item = missions.items[missions.current]
            if item.command == WAYPOINT and missions.current > 0:
                break
            if missions.current + 1 == len(missions.items):
                return
            missions.current += 1
        else:
            return
        n, e = local_of(item.x / 1e7, item.y / 1e7, self.origin)
        d = max(0.0, -item.z)
        away = hypot(n - s.eta[0], e - s.eta[1])
        psi = atan2(e - s.eta[1], n - s.eta[0]) if away > _REACHED else s.eta[5]
        self._target = (n, e, d, psi)
        radius = item.param2 if item.param2 > 0 else _REACHED
        if hypot(away, d - s.eta[2]) > radius:
            self._held_since = None
            return
        if self._held_since is None:
            self._held_since = s.time
            reached = self._mav.MAVLink_mission_item_reached_message(missions.current)
            self._send(reached, None)
        hold = item.param1 if item.param1 > 0 else 0.0
        if s.time - self._held_since >= hold and missions.current + 1 < len(missions.items):
            missions.current += 1
            self._held_since = None


def _outputs(count: int) -> dict[str, float]:
    """Return ArduSub's parameters of `count` motors that push along the thrusters' directions.

    In the frames `vectored` and `vectored_6dof` a positive output of ArduSub pushes against them.
    """
    frame = {6: 1.0, 8: 2.0}.get(count, 7.0)  # vectored, vectored_6dof, custom
    found = {"FRAME_CONFIG": frame}
    for i in range(1, count + 1):
        found[f"SERVO{i}_FUNCTION"] = 32.0 + i
        found[f"MOT_{i}_DIRECTION"] = 1.0 if frame == 7.0 else -1.0
    return found
