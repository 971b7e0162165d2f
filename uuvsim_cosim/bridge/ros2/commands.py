"""Messages of ROS as commands: set-points, forces and thruster commands in NED and FRD."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from uuvsim_cosim.bridge.ros2.frames import Array, body, euler_angles, from_quaternion, world
from uuvsim_cosim.errors import InputInvalid

__all__ = ["COMMANDS", "Command", "command_values"]

_NORM = 0.01  # deviation from 1 that the norm of a quaternion may have


@dataclass(frozen=True)
class Command:
    """A type of message: its roles with their sizes (0: any), and how their values are read."""

    roles: Mapping[str, int]
    read: Callable[[Any], dict[str, Array]]


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
    values = COMMANDS[type_].read(message)
    for role, value in values.items():
        if not np.isfinite(value).all():
            raise InputInvalid(f"{role} {np.array2string(value)}", "finite numbers")
    return values


def _xyz(v: Any) -> Array:
    return np.array([[v.x, v.y, v.z]])


def _row(first: Array, second: Array) -> Array:
    row: Array = np.concatenate([first, second], axis=1)[0]
    return row


def _pose(pose: Any) -> Array:
    q = pose.orientation
    given = np.array([[q.x, q.y, q.z, q.w]])
    norm = float(np.linalg.norm(given))
    if not abs(norm - 1.0) <= _NORM:  # also for NaN
        raise InputInvalid(f"an orientation of norm {norm:g}", "a unit quaternion")
    angles = euler_angles(from_quaternion(given / norm))
    return _row(world(_xyz(pose.position)), angles)


def _twist(twist: Any) -> Array:
    return _row(body(_xyz(twist.linear)), body(_xyz(twist.angular)))


def _velocity(twist: Any) -> dict[str, Array]:
    nu = _twist(twist)
    return {"nu": nu, "axes": nu}


def _wrench(wrench: Any) -> dict[str, Array]:
    return {"tau": _row(body(_xyz(wrench.force)), body(_xyz(wrench.torque)))}


COMMANDS: dict[str, Command] = {
    "geometry_msgs/msg/Twist": Command({"nu": 6, "axes": 0}, _velocity),
    "geometry_msgs/msg/TwistStamped": Command({"nu": 6, "axes": 0}, lambda m: _velocity(m.twist)),
    "geometry_msgs/msg/Wrench": Command({"tau": 6}, _wrench),
    "geometry_msgs/msg/WrenchStamped": Command({"tau": 6}, lambda m: _wrench(m.wrench)),
    "geometry_msgs/msg/PoseStamped": Command({"eta": 6}, lambda m: {"eta": _pose(m.pose)}),
    "nav_msgs/msg/Odometry": Command(
        {"eta": 6, "nu": 6}, lambda m: {"eta": _pose(m.pose.pose), "nu": _twist(m.twist.twist)}
    ),
    "std_msgs/msg/Float64MultiArray": Command({"data": 0}, lambda m: {"data": m.data}),
}
