"""Messages of ROS as signals: the inverse of conversions.py, for recorded topics and for commands.

Each type has the paths of the fields that are read and the signals that follow from them, in NED
and FRD. Signals have the names of the outputs from which such a message is made; those of std_msgs
have the last part of the topic's name. A quaternion keeps the sign of the one before it. A command
is one message, whose signals have roles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import (
    Array,
    body,
    euler_angles,
    from_quaternion,
    world,
    world_variance,
)
from uuvsim_cosim.errors import InputInvalid

__all__ = ["COMMANDS", "READINGS", "Reading", "command_values", "field_values"]

Fields = Mapping[str, Array]
_ETA = ("m", "m", "m", "rad", "rad", "rad")
_NU = ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s")
_TAU = ("N", "N", "N", "N.m", "N.m", "N.m")
_NORM = 0.01  # deviation from 1 that the norm of a quaternion may have


@dataclass(frozen=True)
class Reading:
    """A type of message: the fields that are read, the signals, and the units of these.

    With `is_sensor`, there are signals `t_sample` and `valid`, too. With `gaps`, a NaN is a missing
    echo, which becomes 0.
    """

    fields: tuple[str, ...]
    signals: Callable[[Fields], dict[str, Array]]
    units: Mapping[str, tuple[str | None, ...]]
    is_sensor: bool = False
    gaps: bool = False


def command_values(type_: str, message: Any, frame: str, child: str) -> dict[str, Array]:
    """Return the values of a message by role, in NED and FRD.

    `frame` and `child` are the frames that its header may name; an empty name is accepted, too.
    Raises InputInvalid for other frames, numbers that are not finite, and no unit quaternion.
    """
    for path, expected in (("header.frame_id", frame), ("child_frame_id", child)):
        named = message
        for part in path.split("."):
            named = getattr(named, part, "")
        if named and named != expected:
            raise InputInvalid(f"{path} {named[:80]!r}", f"{expected!r}, or none")
    reading = READINGS[type_]
    fields = {path: field_values(message, path)[None] for path in reading.fields}
    signals = reading.signals(fields)
    values = {role: signals[name][0] for role, (name, _) in COMMANDS[type_].items()}
    for role, value in values.items():
        if not np.isfinite(value).all():
            raise InputInvalid(f"{role} {np.array2string(value)}", "finite numbers")
    return values


def field_values(message: Any, path: str) -> Array:
    """Return the numbers of a field, flat; those of a structure one after the other."""
    for part in path.split("."):
        message = message[int(part)] if part.isdecimal() else getattr(message, part)
    if hasattr(message, "__msgtype__"):
        names = [n for n in vars(message) if not n.startswith("_") and n.islower()]
        return np.concatenate([field_values(message, name) for name in names])
    return np.atleast_1d(np.asarray(message)).ravel()


def _quaternion(q: Array) -> Array:
    """Return quaternions w x y z from FRD to NED without jumps of the sign."""
    norm = np.linalg.norm(q, axis=1)
    if (wrong := np.flatnonzero(np.abs(norm - 1) > _NORM)).size:  # NaN is refused later
        i = wrong[0]
        place = f"message {i + 1}: " if len(q) > 1 else ""
        raise InputInvalid(f"{place}an orientation of norm {norm[i]:g}", "a unit quaternion")
    turned = from_quaternion(q / norm[:, None])
    turned[0] *= 1.0 if turned[0, 0] >= 0 else -1.0
    flips = np.sum(turned[1:] * turned[:-1], axis=1) < 0
    turned[1:] *= np.cumprod(np.where(flips, -1.0, 1.0))[:, None]
    return turned


def _pose(f: Fields, at: str) -> dict[str, Array]:
    q = _quaternion(f[f"{at}.orientation"])
    return {"eta": np.hstack([world(f[f"{at}.position"]), euler_angles(q)]), "q": q}


def _six(f: Fields, first: str, second: str) -> Array:
    return np.hstack([body(f[first]), body(f[second])])


def _odometry(f: Fields) -> dict[str, Array]:
    deviations = [np.sqrt(np.maximum(f[f"{k}.covariance"][:, ::7], 0)) for k in ("pose", "twist")]
    deviations[0][:, :3] = world_variance(deviations[0][:, :3])
    nu = _six(f, "twist.twist.linear", "twist.twist.angular")
    return {**_pose(f, "pose.pose"), "nu": nu, "sigma": np.hstack(deviations)}


def _position(f: Fields) -> dict[str, Array]:
    variance = world_variance(f["pose.covariance"][:, [0, 7, 14]])
    return {"position": world(f["pose.pose.position"]), "sigma": np.sqrt(np.maximum(variance, 0))}


def _twist(at: str) -> Reading:
    paths = (f"{at}linear", f"{at}angular")
    return Reading(paths, lambda f: {"nu_d": _six(f, *paths)}, {"nu_d": _NU})


def _wrench(at: str) -> Reading:
    paths = (f"{at}force", f"{at}torque")
    return Reading(paths, lambda f: {"tau_d": _six(f, *paths)}, {"tau_d": _TAU})


def _pose_stamped(f: Fields) -> dict[str, Array]:
    pose = _pose(f, "pose")
    return {"eta_d": pose["eta"], "q_d": pose["q"]}


def _image(f: Fields) -> dict[str, Array]:
    data = np.ascontiguousarray(f["data"], np.uint8)
    return {"image": data.view("<f4").astype(float)}


def _dvl(f: Fields) -> dict[str, Array]:
    return {
        "altitude": f["altitude"],
        "range": f["range"],
        "beam_velocity": f["beam_velocity"],
        "beam_valid": f["beam_quality"],
    }


_HEADED_POSE = ("pose.pose.position", "pose.pose.orientation")
READINGS: dict[str, Reading] = {
    "geometry_msgs/msg/PoseStamped": Reading(
        ("pose.position", "pose.orientation"),
        _pose_stamped,
        {"eta_d": _ETA, "q_d": ("1",) * 4},
    ),
    "nav_msgs/msg/Odometry": Reading(
        (*_HEADED_POSE, "twist.twist.linear", "twist.twist.angular", "pose.covariance",
         "twist.covariance"),
        _odometry,
        {"eta": _ETA, "q": ("1",) * 4, "nu": _NU, "sigma": _ETA + _NU},
        is_sensor=True,
    ),
    "geometry_msgs/msg/Twist": _twist(""),
    "geometry_msgs/msg/TwistStamped": _twist("twist."),
    "geometry_msgs/msg/Wrench": _wrench(""),
    "geometry_msgs/msg/WrenchStamped": _wrench("wrench."),
    "geometry_msgs/msg/TwistWithCovarianceStamped": Reading(
        ("twist.twist.linear",),
        lambda f: {"velocity": body(f["twist.twist.linear"])},
        {"velocity": ("m/s",) * 3},
        is_sensor=True,
    ),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Reading(
        ("pose.pose.position", "pose.covariance"),
        _position,
        {"position": ("m",) * 3, "sigma": ("m",) * 3},
        is_sensor=True,
    ),
    "sensor_msgs/msg/Imu": Reading(
        ("angular_velocity", "linear_acceleration"),
        lambda f: {"gyro": body(f["angular_velocity"]), "acc": body(f["linear_acceleration"])},
        {"gyro": ("rad/s",) * 3, "acc": ("m/s2",) * 3},
        is_sensor=True,
    ),
    "sensor_msgs/msg/FluidPressure": Reading(
        ("fluid_pressure",),
        lambda f: {"pressure": f["fluid_pressure"]},
        {"pressure": ("Pa",)},
        is_sensor=True,
    ),
    "sensor_msgs/msg/MagneticField": Reading(
        ("magnetic_field",),
        lambda f: {"B": body(f["magnetic_field"])},
        {"B": ("T",) * 3},
        is_sensor=True,
    ),
    "sensor_msgs/msg/Range": Reading(
        ("range",), lambda f: {"altitude": f["range"]}, {"altitude": ("m",)}, is_sensor=True
    ),
    "sensor_msgs/msg/LaserScan": Reading(
        ("ranges",),
        lambda f: {"range": f["ranges"]},
        {"range": ("m",)},
        is_sensor=True,
        gaps=True,
    ),
    "marine_acoustic_msgs/msg/SonarRanges": Reading(
        ("ranges",),
        lambda f: {"range": f["ranges"]},
        {"range": ("m",)},
        is_sensor=True,
        gaps=True,
    ),
    "sensor_msgs/msg/Image": Reading(
        ("data",), _image, {"image": ("m",)}, is_sensor=True, gaps=True
    ),
    "marine_acoustic_msgs/msg/Dvl": Reading(
        ("altitude", "range", "beam_velocity", "beam_quality"),
        _dvl,
        {"altitude": ("m",), "range": ("m",) * 4, "beam_velocity": ("m/s",) * 4,
         "beam_valid": ("1",) * 4},
        is_sensor=True,
        gaps=True,
    ),
    "sensor_msgs/msg/BatteryState": Reading(
        ("voltage", "percentage"),
        lambda f: {"voltage": f["voltage"], "state_of_charge": f["percentage"]},
        {"voltage": ("V",), "state_of_charge": ("1",)},
    ),
    **{
        f"std_msgs/msg/{name}": Reading(("data",), lambda f: {"data": f["data"]}, {"data": (None,)})
        for name in ("Float64", "Float64MultiArray", "Int64", "Int64MultiArray", "Bool",
                     "UInt8MultiArray", "Float32", "Float32MultiArray", "Int32")
    },
}  # fmt: skip
_VELOCITY = {"nu": ("nu_d", 6), "axes": ("nu_d", 0)}
# Of the types that can be commands: the signal of each role, and its size (0: any).
COMMANDS: dict[str, Mapping[str, tuple[str, int]]] = {
    "geometry_msgs/msg/Twist": _VELOCITY,
    "geometry_msgs/msg/TwistStamped": _VELOCITY,
    "geometry_msgs/msg/Wrench": {"tau": ("tau_d", 6)},
    "geometry_msgs/msg/WrenchStamped": {"tau": ("tau_d", 6)},
    "geometry_msgs/msg/PoseStamped": {"eta": ("eta_d", 6)},
    "nav_msgs/msg/Odometry": {"eta": ("eta", 6), "nu": ("nu", 6)},
    "std_msgs/msg/Float64MultiArray": {"data": ("data", 0)},
}
