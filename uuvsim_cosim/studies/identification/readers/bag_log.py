"""Bags of ROS (.mcap, .db3, .bag) as a vehicle log: which message gives which quantity.

Of several topics that give a quantity, the one whose type has the lowest rank is read. Two topics
of equal rank are refused: the bag may be of two vehicles. Vectors are turned from ENU and FLU (REP
103) to NED and FRD, unless the frame of a message ends with ned or frd. A message counts from the
time in its header if that clock is the bag's, else from the time at which it was recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.bridge.ros2.messages.readings import field_values
from uuvsim_cosim.bridge.ros2.topic_writer import typestore
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.studies.identification.readers.channels import Channel, assigned, in_ned
from uuvsim_cosim.studies.identification.readers.px4_log import (
    check_submarine,
    rotors_of,
    series_of_topics,
)
from uuvsim_cosim.studies.identification.vehicle_log import (
    COMMANDS,
    Series,
    VehicleLog,
    check_firmware,
    without_repetitions,
)

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

__all__ = ["is_bag", "read_bag"]

Array = NDArray[np.float64]
_COMPLETE = "a complete bag; `mcap recover` or `ros2 bag reindex` may mend a truncated one"
_CLOCK = 0.5  # s between the clock of a header and that of the bag
_PASCALS, _GRAVITY = 101325.0, 9.80665 * 1025.0  # Pa at the surface, Pa/m
_PX4 = "px4_msgs/msg/"
# Series of each type of message: rank, and field.
_ODOMETRY = {
    "position": (0, "pose.pose.position"), "attitude": (0, "pose.pose.orientation"),
    "dvl": (2, "twist.twist.linear"), "rates": (1, "twist.twist.angular"),
}  # fmt: skip
_TYPES: dict[str, dict[str, tuple[int, str]]] = {
    "nav_msgs/msg/Odometry": _ODOMETRY,
    "sensor_msgs/msg/Imu": {"attitude": (1, "orientation"), "rates": (0, "angular_velocity")},
    "geometry_msgs/msg/PoseStamped": {
        "position": (1, "pose.position"), "attitude": (2, "pose.orientation"),
    },
    "geometry_msgs/msg/PoseWithCovarianceStamped": {
        "position": (2, "pose.pose.position"), "attitude": (3, "pose.pose.orientation"),
    },
    "geometry_msgs/msg/TwistWithCovarianceStamped": {"dvl": (1, "twist.twist.linear")},
    "geometry_msgs/msg/TwistStamped": {"dvl": (3, "twist.linear"), "rates": (2, "twist.angular")},
    "geometry_msgs/msg/WrenchStamped": {"tau": (0, "wrench")},
    "marine_acoustic_msgs/msg/Dvl": {"dvl": (0, "velocity"), "range": (0, "altitude")},
    "sensor_msgs/msg/Range": {"range": (1, "range")},
    "sensor_msgs/msg/BatteryState": {"voltage": (0, "voltage")},
    "sensor_msgs/msg/FluidPressure": {"depth": (1, "fluid_pressure")},
    "mavros_msgs/msg/RCOut": {"pwm": (0, "channels")},
    "mavros_msgs/msg/State": {"armed": (0, "armed")},
}  # fmt: skip
_PLAIN = ("u", "pwm", "depth", "range", "voltage", "armed")  # topics of std_msgs by their last part
_EARTH = ("map", "odom", "world", "earth", "local_origin")  # frames in which a twist is no DVL's
# Definitions of messages that bags of ROS 2 Humble and older do not contain.
_DEFINITIONS = {
    "mavros_msgs/msg/RCOut": "std_msgs/Header header\nuint16[] channels\n",
    "mavros_msgs/msg/State": "std_msgs/Header header\nbool connected\nbool armed\nbool guided\n"
    "bool manual_input\nstring mode\nuint8 system_status\n",
}


def is_bag(path: Path) -> bool:
    """Whether a path is a bag, and no recording of this package."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() and not list(path.glob("signals.*"))
    if path.suffix.lower() != ".mcap":
        return path.suffix.lower() in (".db3", ".bag")
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    try:
        with path.open("rb") as stream:
            return bool(make_reader(stream).get_header().library != "uuvsim-cosim")
    except (McapError, OSError, ValueError):
        return False


def read_bag(path: Path, given: Mapping[str, float], channels: Mapping[str, Channel]) -> VehicleLog:
    """Read a bag; `given` are parameters of its autopilot, and `channels` replace the usual topics.

    Raises InputInvalid for an unreadable bag, and for topics that are not unambiguous.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import get_types_from_msg
    except ImportError:
        raise InputInvalid(
            path, "bags are decoded by rosbags", "`pip install 'uuvsim-cosim[logs]'`"
        ) from None
    store = typestore("jazzy")
    for name, text in _DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    try:
        with AnyReader([path], default_typestore=store) as reader:
            return _Bag(path, reader).log(given, channels)
    except InputInvalid:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise InputInvalid(path, f"cannot be read ({error})", _COMPLETE) from None
    except Exception as error:  # sqlite3.Error, struct.error, those of decompressors
        shown = f"{type(error).__name__}: {error}"
        raise InputInvalid(path, f"cannot be read ({shown})", _COMPLETE) from None


@dataclass(frozen=True)
class _Messages:
    """Values of fields of a topic's messages: times [s] from the bag's begin, numbers, frame."""

    t: Array
    values: Array
    frame: str


@final
class _Bag:
    """The topics of an open bag."""

    def __init__(self, path: Path, reader: AnyReader) -> None:
        self.path, self.reader = path, reader
        self.types = {c.topic: c.msgtype for c in reader.connections if c.msgcount}
        self.remarks: list[str] = []
        self.used: set[str] = set()

    def log(self, given: Mapping[str, float], channels: Mapping[str, Channel]) -> VehicleLog:
        """Return what the bag holds as a log."""
        check_firmware(self.path, "", given)
        series = assigned(self.path, channels, self._channel, frame="ros")
        for channel in channels.values():
            turned = (
                f", in the frame {channel.frame or 'ros (REP 103)'}" if channel.is_turned else ""
            )
            self.remarks.append(f"{channel.series} is {channel.place}{turned}")
        for name, topic in self._chosen(set(channels)).items():
            found = self._series(name, topic)
            if found is not None:
                series[name] = found
        vehicle: str | None = None
        frame: str | None = None
        topics = self._uorb()
        if topics:
            check_submarine(self.path, None, topics)
            for name, found in series_of_topics(self.path, topics).items():
                series.setdefault(name, found)
            if "actuator_motors" in topics and not COMMANDS & series.keys():
                table = topics["actuator_motors"]
                count = int(given.get("CA_ROTOR_COUNT", 12))
                controls = np.stack([table[f"control[{i}]"] for i in range(count)], axis=1)
                rotors = rotors_of(self.path, given, count)
                series["u"] = Series(table["timestamp"] * 1e-6, rotors.commands(controls))
                vehicle, frame = rotors.vehicle, rotors.frame
                self.remarks += rotors.remarks
        if "depth" not in series and "position" in series:
            self.remarks.append(
                "the depth was not recorded, and the origin of the position may be anywhere: parts "
                "at the surface are not left out"
            )
        others = sorted(t for t in self.types if t not in self.used and "/rosout" not in t)
        if others:
            more = f" and {len(others) - 8} more" if len(others) > 8 else ""
            self.remarks.append(f"topics that are not read: {', '.join(others[:8])}{more}")
        return VehicleLog(self.path, series, dict(given), "", tuple(self.remarks), vehicle, frame)

    # ---- which topic --------------------------------------------------------------------------

    def _chosen(self, others: set[str]) -> dict[str, str]:
        """Return the topic of each series but `others`; refuses two topics of equal rank."""
        others = others | (COMMANDS if COMMANDS & others else set())
        candidates: dict[str, list[tuple[int, str]]] = {}
        for topic, type_ in self.types.items():
            for name, (rank, _) in _TYPES.get(type_, {}).items():
                candidates.setdefault(name, []).append((rank, topic))
            last = topic.rpartition("/")[2]
            if type_.startswith("std_msgs/msg/") and last in _PLAIN:
                candidates.setdefault(last, []).append((0, topic))
        chosen = {}
        for name, found in candidates.items():
            usable = [f for f in sorted(found) if self._is_usable(name, f[1])]
            if name in others or not usable:
                continue
            least = [topic for rank, topic in usable if rank == usable[0][0]]
            if len(least) > 1:
                raise InputInvalid(
                    self.path,
                    f"{len(least)} topics give the {name}: {', '.join(least)}",
                    f"a bag of one vehicle, or --channel {name}={least[0]}, for example",
                )
            chosen[name] = least[0]
            rest = [topic for _, topic in usable[1:]]
            instead = f" (not {', '.join(rest)})" if rest else ""
            self.remarks.append(f"{name} is {least[0]}{instead}")
        return chosen

    def _is_usable(self, name: str, topic: str) -> bool:
        """Whether the first message of a topic has the quantity."""
        type_ = self.types[topic]
        if type_ == "sensor_msgs/msg/Imu" and name == "attitude":
            message = self._first(topic)
            norm = np.linalg.norm(field_values(message, "orientation"))
            return bool(message.orientation_covariance[0] != -1.0 and abs(norm - 1.0) < 0.01)
        if type_ == "geometry_msgs/msg/TwistStamped":
            return self._first(topic).header.frame_id.strip("/") not in _EARTH
        return True

    def _first(self, topic: str) -> Any:
        connections = [c for c in self.reader.connections if c.topic == topic]
        connection, _, raw = next(self.reader.messages(connections))
        return self.reader.deserialize(raw, connection.msgtype)

    # ---- what its messages hold ---------------------------------------------------------------

    def _series(self, name: str, topic: str) -> Series | None:
        type_ = self.types[topic]
        field = _TYPES[type_][name][1] if type_ in _TYPES else "data"
        extra = {
            "sensor_msgs/msg/Range": ("min_range", "max_range"),
            "marine_acoustic_msgs/msg/Dvl": ("altitude",),
        }.get(type_, ())
        found = self._messages(topic, (field, *extra))
        size = found.values.shape[1] - len(extra)
        values, keep = found.values[:, :size], np.isfinite(found.values[:, :size]).any(axis=1)
        if type_ == "sensor_msgs/msg/Range":
            low, high = found.values[:, size], found.values[:, size + 1]
            keep &= (values[:, 0] > low) & (values[:, 0] < high)
        elif extra:  # a DVL without a lock has no altitude
            keep &= found.values[:, size] > 0.0
        if type_ == "sensor_msgs/msg/FluidPressure":
            values = (values - _PASCALS) / _GRAVITY
            self.remarks.append(
                f"{topic}: depth of the pressure above {_PASCALS:g} Pa in water of 1025 kg/m3, "
                "which is assumed"
            )
        if not keep.any():
            return None
        turned = in_ned(name, values[keep], found.frame)
        series = without_repetitions(self.path, topic, found.t[keep], turned)
        if name == "armed":
            t = np.concatenate([[-np.inf], series.t])
            series = Series(t, np.concatenate([series.values[:1], series.values]))
        return series

    def _channel(self, channel: Channel) -> tuple[Array, Array]:
        topic = channel.topic
        if topic not in self.types:
            raise InputInvalid(
                f"{self.path}: {channel}", f"no topic {topic!r}",
                expected_names(topic, sorted(self.types)),
            )  # fmt: skip
        type_ = self.types[topic]
        fields = channel.fields
        if not fields:
            usual = _TYPES.get(type_, {}).get(channel.series)
            if usual is None and not type_.startswith("std_msgs/msg/"):
                raise InputInvalid(
                    f"{self.path}: {channel}", f"{type_} has several fields",
                    f"--channel {channel.series}={topic}:FIELD",
                )  # fmt: skip
            fields = (usual[1] if usual else "data",)
        found = self._messages(topic, fields, str(channel))
        return found.t, found.values

    def _messages(self, topic: str, fields: tuple[str, ...], place: str = "") -> _Messages:
        """Return fields of all messages of a topic."""
        self.used.add(topic)
        where = f"{self.path}: {place or topic}"
        connections = [c for c in self.reader.connections if c.topic == topic]
        recorded: list[int] = []
        stamped: list[int] = []
        rows: list[Array] = []
        frame = ""
        for connection, time, raw in self.reader.messages(connections):
            try:
                message: Any = self.reader.deserialize(raw, connection.msgtype)
                rows.append(np.concatenate([field_values(message, f) for f in fields]))
            except Exception as error:  # bytes of another program, or a field that is not there
                shown = f"a message cannot be read ({type(error).__name__}: {error})"
                raise InputInvalid(where, shown, f"fields of {connection.msgtype}") from None
            header = getattr(message, "header", None)
            frame = frame or getattr(header, "frame_id", "")
            recorded.append(time)
            own = 0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec
            stamped.append(own or time)
        if not rows:
            raise InputInvalid(where, "no message", "at least one")
        if len({len(row) for row in rows}) > 1:
            raise InputInvalid(
                where, "messages with different numbers of elements", "equal numbers"
            )
        begin = self.reader.start_time
        at, own_at = (
            np.asarray((np.array(x, np.int64) - begin) * 1e-9, np.float64)
            for x in (recorded, stamped)
        )
        offset = float(np.median(np.abs(own_at - at)))
        if offset > _CLOCK:
            self.remarks.append(
                f"{topic}: the clock of its headers is {offset:.3g} s from the bag's, whose times "
                "are used"
            )
        t: Array = at if offset > _CLOCK else own_at
        order = np.argsort(at, kind="stable")
        is_ned = frame.rstrip("/").lower().endswith(("ned", "frd"))
        return _Messages(t[order], np.array(rows, dtype=float)[order], "ned" if is_ned else "ros")

    def _uorb(self) -> dict[str, dict[str, Array]]:
        """Return the topics of PX4 in the bag as tables by the names of uORB."""
        found: dict[str, dict[str, Array]] = {}
        for topic, type_ in self.types.items():
            name = topic.rpartition("/")[2].partition("_v")[0] if type_.startswith(_PX4) else ""
            name = _snake(type_.removeprefix(_PX4)) if name and "visual" not in topic else name
            if name not in _UORB:
                continue
            connections = [c for c in self.reader.connections if c.topic == topic]
            columns: dict[str, list[float]] = {}
            for connection, time, raw in self.reader.messages(connections):
                message = self.reader.deserialize(raw, connection.msgtype)
                row = {"timestamp": (time - self.reader.start_time) * 1e-3}
                for field, value in vars(message).items():
                    if field in ("timestamp", "timestamp_sample") or field.startswith("_"):
                        continue
                    if isinstance(value, np.ndarray):
                        row |= {f"{field}[{i}]": float(v) for i, v in enumerate(value)}
                    elif isinstance(value, (int, float)):
                        row[field] = float(value)
                for field, number in row.items():
                    columns.setdefault(field, []).append(number)
            self.used.add(topic)
            found[name] = {k: np.array(v) for k, v in columns.items()}
            self.remarks.append(f"{topic}: {type_}, by the times at which it was recorded")
        return found


_UORB = (
    "vehicle_attitude", "vehicle_angular_velocity", "vehicle_local_position", "sensor_combined",
    "vehicle_visual_odometry", "vehicle_odometry", "distance_sensor", "battery_status",
    "actuator_armed", "vehicle_status", "actuator_motors",
)  # fmt: skip


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).lstrip("_")
