"""Logs of PX4 (.ulg) as a vehicle log: which topic of uORB gives which quantity.

Motor i pushes along its axis (CA_ROTORi_AX, …) with its command c_i. If all axes and places are
those of a vehicle of this package, thruster j has the command of the motor that is there,

    u_j = sign(a_i . e_j) c_i.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import partial
from io import StringIO
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.bridge.ros2.frames import euler_angles
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.studies.identification.readers.channels import Channel, assigned
from uuvsim_cosim.studies.identification.vehicle_log import (
    Series,
    VehicleLog,
    with_depth,
    without_repetitions,
)

__all__ = ["Rotors", "Topics", "read_px4", "rotors_of", "series_of_topics"]

Array = NDArray[np.float64]
Table = Mapping[str, Array]  # columns of a topic by field, with `timestamp` [us]
Topics = Mapping[str, Table]  # first instance of each topic by its name
_SUBMARINE, _DOWN, _ARMED, _NED, _BODY_FRD, _VALID = 12, 25, 2, 1, 3, 0.5
_HEADER, _KINDS = 16, frozenset(b"FDIMPQARSOLCB")  # bytes, and letters of messages
_MOTOR_1 = 101  # function of an output
_SHIPPED = ("bluerov2", "bluerov2_heavy")
_NEAR, _PARALLEL = 0.35, 0.9  # of places by the largest distance, and of directions
_READ = (
    "vehicle_attitude", "vehicle_angular_velocity", "vehicle_local_position", "sensor_combined",
    "vehicle_visual_odometry", "vehicle_odometry", "distance_sensor", "battery_status",
    "actuator_armed", "vehicle_status", "actuator_motors", "actuator_outputs",
)  # fmt: skip


def read_px4(path: Path, given: Mapping[str, float], channels: Mapping[str, Channel]) -> VehicleLog:
    """Read a .ulg; raises InputInvalid for a log of another vehicle than a submarine.

    `given` are parameters in addition to those of the log, and `channels` replace its usual topics.
    """
    try:
        from pyulog import ULog
    except ImportError:
        raise InputInvalid(
            path, "logs of PX4 are decoded by pyulog", "`pip install 'uuvsim-cosim[logs]'`"
        ) from None
    with path.open("rb") as file:
        head = file.read(8)
    if not head.startswith(b"ULog"):
        raise InputInvalid(path, f"begins with {head.hex(' ') or 'nothing'}", "a ULog of PX4")
    remarks = list(_damage(path))
    try:
        with redirect_stdout(StringIO()):  # pyulog prints what it finds damaged
            log: Any = ULog(str(path), [*_READ, *(c.topic for c in channels.values())])
    except Exception as error:  # bytes of another program: whatever pyulog raises for them
        shown = str(error) or type(error).__name__
        raise InputInvalid(path, f"cannot be read ({shown})", "a complete ULog of PX4") from None
    parameters = {n: float(v) for n, v in log.initial_parameters.items()}
    for _, name, value in log.changed_parameters:
        parameters[name] = float(value)
    parameters |= given
    topics: dict[str, Table] = {}
    for data in sorted(log.data_list, key=lambda d: d.multi_id):
        columns = {n: np.asarray(v, dtype=float) for n, v in data.data.items()}
        if len(columns["timestamp"]):
            topics.setdefault(data.name, columns)
    firmware = f"PX4 {log.msg_info_dict.get('ver_sw_branch', '')}".strip()
    check_submarine(path, parameters.get("MAV_TYPE"), topics)
    if not topics:
        why = "".join(f" ({r})" for r in remarks)
        raise InputInvalid(
            path, f"holds no message that is read{why}", f"such as {_READ[0]} or {_READ[2]}"
        )
    if log.dropouts:
        lost = sum(d.duration for d in log.dropouts) * 1e-3
        remarks.append(f"{len(log.dropouts)} dropouts of the logger, {lost:.3g} s in all")
    series = series_of_topics(path, topics)
    vehicle = frame = None
    commands = _motors(path, topics, parameters)
    if commands is not None:
        rotors = rotors_of(path, parameters, commands.values.shape[1])
        series["u"] = Series(commands.t, rotors.commands(commands.values))
        vehicle, frame = rotors.vehicle, rotors.frame
        remarks += rotors.remarks
    series |= assigned(path, channels, partial(_channel, path, topics))
    return VehicleLog(
        path, with_depth(series), parameters, firmware, tuple(remarks), vehicle, frame
    )


def _channel(path: Path, topics: Topics, channel: Channel) -> tuple[Array, Array]:
    """Return times and numbers of a topic's fields; an array of a message is one field."""
    place = f"{path}: {channel}"
    table = topics.get(channel.topic)
    if table is None:
        raise InputInvalid(
            place, f"no topic {channel.topic!r}", expected_names(channel.topic, sorted(topics))
        )
    columns = []
    for field in channel.fields:
        own = [n for n in table if n == field or n.startswith(f"{field}[")]
        if not own:
            raise InputInvalid(place, f"no field {field!r}", expected_names(field, sorted(table)))
        columns += [table[n] for n in own]
    if not columns:
        raise InputInvalid(place, "no field", f"{channel.topic}:FIELD")
    values = np.stack(columns, axis=1)
    if channel.series == "attitude" and values.shape[1] == 4:  # PX4 has w x y z
        values = values[:, [1, 2, 3, 0]]
    return table["timestamp"] * 1e-6, values


def _damage(path: Path) -> Iterator[str]:
    """Yield a remark on bytes that are no message, or on an incomplete last message."""
    end, at = path.stat().st_size, _HEADER
    if end <= at:
        yield f"the log ends after {end} bytes"
        return
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
        while at + 3 <= end and data[at + 2] in _KINDS:
            at += 3 + (data[at] | data[at + 1] << 8)
    if at < end - 2 and at + 3 <= end:
        yield f"bytes from {at} of {end} on are damaged: messages behind them may be missing"
    elif at != end:
        yield f"the log ends within a message, after {end} bytes"


def check_submarine(path: Path, kind: float | None, topics: Topics) -> None:
    """Refuse another vehicle by MAV_TYPE, or by the type in the status."""
    status = topics.get("vehicle_status", {})
    if kind is None and "system_type" in status:
        kind = float(status["system_type"][-1])
    if kind is not None and round(kind) not in (_SUBMARINE, 0):
        raise InputInvalid(
            path, f"a log of vehicle type {kind:g} (MAV_TYPE)",
            f"a submarine (type {_SUBMARINE}) with PX4",
        )  # fmt: skip


# ---- what was measured ------------------------------------------------------------------------


def series_of_topics(path: Path, topics: Topics) -> dict[str, Series]:
    """Return the series that topics of uORB give, all but commands."""
    found: dict[str, Series] = {}

    def put(to: str, topic: str, values: Array, keep: NDArray[np.bool_] | None = None) -> None:
        t = topics[topic]["timestamp"] * 1e-6
        keep = np.ones(len(t), bool) if keep is None else keep
        keep = keep & np.isfinite(values).any(axis=1)
        if keep.any():
            found[to] = without_repetitions(path, topic, t[keep], values[keep])

    for topic, fields in (
        ("vehicle_angular_velocity", "xyz[{}]"), ("sensor_combined", "gyro_rad[{}]"),
        ("vehicle_attitude", ("rollspeed", "pitchspeed", "yawspeed")),
    ):  # fmt: skip
        rates = _columns(topics, topic, fields, 3)
        if rates is not None and "rates" not in found:
            put("rates", topic, rates)
    q = _columns(topics, "vehicle_attitude", "q[{}]", 4)
    if q is not None:
        put("attitude", "vehicle_attitude", euler_angles(q))
    _put_position(topics, put)
    _put_odometry(topics, found, put)
    velocity = _columns(topics, "vehicle_visual_odometry", "velocity[{}]", 3)
    if velocity is not None:  # by which PX4 takes the velocity of a DVL
        frame = topics["vehicle_visual_odometry"].get("velocity_frame")
        if frame is not None:
            put("dvl", "vehicle_visual_odometry", velocity, frame == _BODY_FRD)
    if "distance_sensor" in topics:
        s = topics["distance_sensor"]
        d = s["current_distance"]
        good = (s["orientation"] == _DOWN) & (d > s["min_distance"]) & (d < s["max_distance"])
        put("range", "distance_sensor", d[:, None], good)
    voltage = topics.get("battery_status", {}).get("voltage_v")
    if voltage is not None:
        put("voltage", "battery_status", voltage[:, None], voltage > 0.0)
    for topic, field, value in (
        ("vehicle_status", "arming_state", _ARMED), ("actuator_armed", "armed", 1),
    ):  # fmt: skip
        state = topics.get(topic, {}).get(field)
        if state is not None:
            put("armed", topic, (state == value)[:, None].astype(float))
    if "armed" in found:  # as at the first message
        armed = found["armed"]
        found["armed"] = Series(
            np.concatenate([[-np.inf], armed.t]), np.concatenate([armed.values[:1], armed.values])
        )
    return found


def _put_position(topics: Topics, put: Any) -> None:
    """Add position and velocity of the estimator where it states that they are valid."""
    name = "vehicle_local_position"
    for to, fields, flags in (
        ("position", ("x", "y", "z"), ("xy_valid", "z_valid")),
        ("velocity", ("vx", "vy", "vz"), ("v_xy_valid", "v_z_valid")),
    ):
        values = _columns(topics, name, fields, 3)
        if values is None:
            continue
        values = values.copy()
        for flag, columns in zip(flags, (slice(0, 2), slice(2, 3)), strict=True):
            valid = topics[name].get(flag)
            if valid is not None:
                values[valid < _VALID, columns] = np.nan
        put(to, name, values)
    if "distance_sensor" not in topics and name in topics:
        bottom, valid = (topics[name].get(f) for f in ("dist_bottom", "dist_bottom_valid"))
        if bottom is not None and valid is not None:
            put("range", name, bottom[:, None], valid >= _VALID)


def _put_odometry(topics: Topics, found: Mapping[str, Series], put: Any) -> None:
    """Add what only the estimator's odometry has, if it is in NED."""
    name = "vehicle_odometry"
    for to, fields, n, frame in (
        ("position", "position[{}]", 3, "pose_frame"), ("attitude", "q[{}]", 4, "pose_frame"),
        ("velocity", "velocity[{}]", 3, "velocity_frame"), ("rates", "angular_velocity[{}]", 3, ""),
    ):  # fmt: skip
        values = _columns(topics, name, fields, n)
        if values is not None and to not in found:
            is_ned = np.ones(len(values), bool) if not frame else topics[name][frame] == _NED
            put(to, name, euler_angles(values) if n == 4 else values, is_ned)


def _columns(topics: Topics, topic: str, fields: str | tuple[str, ...], n: int) -> Array | None:
    names = [fields.format(i) for i in range(n)] if isinstance(fields, str) else fields
    table = topics.get(topic, {})
    if not set(names) <= table.keys():
        return None
    return np.stack([table[name] for name in names], axis=1)


# ---- commands ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rotors:
    """Motors of a log in the order of a vehicle's thrusters: number (from 0) and sign of each."""

    motors: tuple[int, ...]
    signs: tuple[float, ...]
    vehicle: str | None
    frame: str
    remarks: tuple[str, ...]

    def commands(self, controls: Array) -> Array:
        """Return the thrusters' commands (n, thrusters) of the motors' (n, motors), -1 to 1."""
        c = np.nan_to_num(controls[:, self.motors])
        return np.clip(np.array(self.signs) * c, -1.0, 1.0) + 0.0


def _motors(path: Path, topics: Topics, parameters: Mapping[str, float]) -> Series | None:
    """Return the motors' commands: of the allocation, else of the outputs by their functions."""
    count = int(parameters.get("CA_ROTOR_COUNT", 0))
    table = topics.get("actuator_motors")
    if table is not None:
        width = count or sum(f"control[{i}]" in table for i in range(12))
        values = np.stack([table[f"control[{i}]"] for i in range(width)], axis=1)
        return without_repetitions(path, "actuator_motors", table["timestamp"] * 1e-6, values)
    table = topics.get("actuator_outputs")
    if table is None:
        return None
    functions = {
        int(parameters.get(f"PWM_MAIN_FUNC{n}", 0)) - _MOTOR_1: n
        for n in range(1, 17) if f"output[{n - 1}]" in table
    }  # fmt: skip
    lacking = [i for i in range(max(count, 1)) if i not in functions]
    if lacking or not count:
        raise InputInvalid(
            path,
            "has actuator_outputs, and its parameters do not name the output of motor "
            f"{', '.join(str(i + 1) for i in lacking) or '1'}",
            f"CA_ROTOR_COUNT, and PWM_MAIN_FUNCn = {_MOTOR_1} to {_MOTOR_1 + max(count, 1) - 1}; "
            "or a log with actuator_motors",
        )
    rows = []
    for i in range(count):
        n = functions[i]
        low = parameters.get(f"PWM_MAIN_MIN{n}", 1000.0)
        high = parameters.get(f"PWM_MAIN_MAX{n}", 2000.0)
        w = table[f"output[{n - 1}]"]
        rows.append(np.where(w >= low, (2 * w - low - high) / (high - low), 0.0))
    values = np.stack(rows, axis=1)
    return without_repetitions(path, "actuator_outputs", table["timestamp"] * 1e-6, values)


def rotors_of(path: Path, parameters: Mapping[str, float], count: int) -> Rotors:
    """Assign the motors to the thrusters of a vehicle by places and axes in the parameters."""
    named = [f"CA_ROTOR{i}_{k}" for i in range(count) for k in ("PX", "PY", "AX", "AY", "AZ")]
    lacking = [n for n in named if n not in parameters]
    if lacking:
        raise InputInvalid(
            path,
            f"lacks the parameters {', '.join(lacking[:4])}{' …' if len(lacking) > 4 else ''}, so "
            "that nobody knows which motor is where and in which direction it pushes",
            "a log with its parameters, or --log-parameters with a file of them",
        )
    r, a = (
        np.array([[parameters.get(f"CA_ROTOR{i}_{k}{x}", 0.0) for x in "XYZ"]
                  for i in range(count)])
        for k in ("P", "A")
    )  # fmt: skip
    a = a / np.maximum(np.linalg.norm(a, axis=1, keepdims=True), 1e-9)
    for vehicle in _SHIPPED:
        matched = _matched(r, a, vehicle)
        if matched is None:
            continue
        motors, signs = matched
        turned = ", ".join(str(i + 1) for i, s in zip(motors, signs, strict=True) if s < 0)
        remark = f"motors 1 to {count} are thrusters of {vehicle}, by CA_ROTORn"
        if turned:
            remark += f"; axes of motors {turned} point the other way"
        return Rotors(motors, signs, vehicle, f"of PX4 with {count} motors", (remark,))
    return Rotors(
        tuple(range(count)), (1.0,) * count, None, f"of PX4 with {count} motors",
        ("no vehicle here has thrusters at these places (CA_ROTORn): u is in the order of PX4's "
         "motors, and positive along their axes",),
    )  # fmt: skip


def _matched(r: Array, a: Array, vehicle: str) -> tuple[tuple[int, ...], tuple[float, ...]] | None:
    """Return motor and sign of each thruster of a vehicle; None if places or axes differ."""
    from scipy.optimize import linear_sum_assignment

    geometry = thruster_geometry(vehicle)
    if len(geometry.r) != len(r):
        return None
    scale = max(float(np.linalg.norm(r[:, :2], axis=1).max()), 1e-9)
    size = float(np.linalg.norm(geometry.r[:, :2], axis=1).max())
    apart = np.linalg.norm(
        geometry.r[:, None, :2] / size - r[None, :, :2] / scale, axis=2
    )  # (thrusters, motors)
    along = geometry.e @ a.T
    thrusters, motors = linear_sum_assignment(apart + 10.0 * (np.abs(along) < _PARALLEL))
    good = (np.abs(along[thrusters, motors]) >= _PARALLEL) & (apart[thrusters, motors] < _NEAR)
    if not good.all():
        return None
    signs = np.sign(along[thrusters, motors])
    return tuple(int(i) for i in motors), tuple(float(s) for s in signs)
