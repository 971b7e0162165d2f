"""Small bags of ROS 2, written here by rosbags."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg

from uuvsim_cosim.bridge.ros2.topic_writer import typestore

__all__ = ["STORE", "bag", "commands", "depth", "imu", "numbers", "odometry", "outputs", "px4",
           "state", "wrench"]  # fmt: skip

STORE = typestore("jazzy")
STORE.register(get_types_from_msg("std_msgs/Header header\nuint16[] channels\n",
                                  "mavros_msgs/msg/RCOut"))  # fmt: skip
STORE.register(get_types_from_msg(
    "std_msgs/Header header\nbool connected\nbool armed\nbool guided\nbool manual_input\n"
    "string mode\nuint8 system_status\n", "mavros_msgs/msg/State"))  # fmt: skip
for _name, _fields in (
    ("VehicleAttitude", "float32[4] q"), ("ActuatorMotors", "float32[12] control"),
    ("VehicleLocalPosition", "float32 x\nfloat32 y\nfloat32 z\nfloat32 vx\nfloat32 vy\nfloat32 vz\n"
     "bool xy_valid\nbool z_valid\nbool v_xy_valid\nbool v_z_valid"),
    ("VehicleStatus", "uint8 arming_state\nuint8 system_type"),
):  # fmt: skip
    _text = f"uint64 timestamp\n{_fields}\n"
    STORE.register(get_types_from_msg(_text, f"px4_msgs/msg/{_name}"))
EPOCH = 1_700_000_000_000_000_000  # [ns] a day of 2023
Times = Iterable[int]  # [ns] from the epoch
TIMES = range(0, 6_000_000_000, 100_000_000)
Written = list[tuple[str, int, Any]]


def made(name: str, **fields: Any) -> Any:
    return STORE.types[name](**fields)


def header(time: int, frame: str) -> Any:
    stamp = made("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(kind: str, v: Iterable[float]) -> Any:
    return made(f"geometry_msgs/msg/{kind}", **dict(zip("xyzw", v, strict=False)))


def each(topic: str, times: Times, message: Callable[[int], Any]) -> Written:
    return [(topic, EPOCH + t, message(EPOCH + t)) for t in times]


def odometry(topic: str = "/odom", times: Times = TIMES, *, late: int = 0) -> Written:
    """East at 1 m/s with the bow to the east (yaw 0 in ENU), 5 m deep, rolled by 0.1 rad."""

    def message(t: int) -> Any:
        s = (t - EPOCH) * 1e-9
        pose = made("geometry_msgs/msg/Pose", position=vector("Point", (s, 2.0, -5.0)),
                    orientation=vector("Quaternion", (sin(0.05), 0.0, 0.0, cos(0.05))))  # fmt: skip
        twist = made("geometry_msgs/msg/Twist", linear=vector("Vector3", (1.0, 0.2, 0.1)),
                     angular=vector("Vector3", (0.01, -0.02, -0.03)))  # fmt: skip
        return made(
            "nav_msgs/msg/Odometry", header=header(t - late, "odom"), child_frame_id="base_link",
            pose=made("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=made("geometry_msgs/msg/TwistWithCovariance", twist=twist,
                       covariance=np.zeros(36)),
        )  # fmt: skip

    return each(topic, times, message)


def imu(topic: str = "/imu/data", times: Times = TIMES, *, oriented: bool = True) -> Written:
    """Yaw of a quarter turn in ENU: the bow points north."""

    def message(t: int) -> Any:
        h = cos(pi / 4)
        return made(
            "sensor_msgs/msg/Imu", header=header(t, "imu"),
            orientation=vector("Quaternion", (0.0, 0.0, h, h) if oriented else (0, 0, 0, 0)),
            orientation_covariance=np.zeros(9),
            angular_velocity=vector("Vector3", (0.1, -0.2, -0.3)),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector("Vector3", (0.0, 0.0, 9.8)),
            linear_acceleration_covariance=np.zeros(9),
        )  # fmt: skip

    return each(topic, times, message)


def wrench(topic: str = "/wrench", times: Times = TIMES) -> Written:
    return each(topic, times, lambda t: made(
        "geometry_msgs/msg/WrenchStamped", header=header(t, "base_link"),
        wrench=made("geometry_msgs/msg/Wrench", force=vector("Vector3", (10.0, 2.0, 3.0)),
                    torque=vector("Vector3", (0.1, 0.2, 0.3))),
    ))  # fmt: skip


def numbers(topic: str, values: Iterable[float], times: Times = TIMES) -> Written:
    layout = made("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    data = np.array(list(values), float)
    return each(
        topic, times, lambda t: made("std_msgs/msg/Float64MultiArray", layout=layout, data=data)
    )


def commands(values: Iterable[float], topic: str = "/thrusters/u") -> Written:
    return numbers(topic, values)


def outputs(widths: Iterable[int], topic: str = "/mavros/rc/out") -> Written:
    channels = np.array(list(widths), np.uint16)
    return each(topic, TIMES, lambda t: made(
        "mavros_msgs/msg/RCOut", header=header(t, ""), channels=channels))  # fmt: skip


def state(armed: bool, topic: str = "/mavros/state") -> Written:
    return each(topic, TIMES, lambda t: made(
        "mavros_msgs/msg/State", header=header(t, ""), connected=True, armed=armed, guided=True,
        manual_input=False, mode="ALT_HOLD", system_status=4))  # fmt: skip


def px4(motors: Iterable[float], *, kind: int = 12) -> Written:
    """Heading north, 5 m deep, as PX4 sends its topics over DDS."""
    control = np.array([*motors, *[np.nan] * 12][:12], np.float32)
    attitude = np.array([1.0, 0.0, 0.0, 0.0], np.float32)
    valid = dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), True)
    place = dict.fromkeys(("x", "y", "vx", "vy", "vz"), 0.0) | {"z": 5.0}
    return [
        *each("/fmu/out/actuator_motors", TIMES, lambda t: made(
            "px4_msgs/msg/ActuatorMotors", timestamp=1, control=control)),
        *each("/fmu/out/vehicle_attitude", TIMES, lambda t: made(
            "px4_msgs/msg/VehicleAttitude", timestamp=1, q=attitude)),
        *each("/fmu/out/vehicle_local_position_v1", TIMES, lambda t: made(
            "px4_msgs/msg/VehicleLocalPosition", timestamp=1, **place, **valid)),
        *each("/fmu/out/vehicle_status_v1", TIMES, lambda t: made(
            "px4_msgs/msg/VehicleStatus", timestamp=1, arming_state=2, system_type=kind)),
    ]  # fmt: skip


def depth(value: float, topic: str = "/bar30/depth") -> Written:
    return each(topic, TIMES, lambda t: made("std_msgs/msg/Float64", data=value))


def bag(folder: Path, *messages: Written, plugin: StoragePlugin = StoragePlugin.MCAP) -> Path:
    """Write a rosbag2 of messages in the order of their times."""
    with Writer(folder, version=9, storage_plugin=plugin) as out:
        every = sorted((m for part in messages for m in part), key=lambda m: m[1])
        topics = {
            topic: out.add_connection(topic, type_, typestore=STORE)
            for topic, type_ in {topic: m.__msgtype__ for topic, _, m in every}.items()
        }
        for topic, time, message in every:
            out.write(topics[topic], time, STORE.serialize_cdr(message, message.__msgtype__))
    return folder
