"""Channels: where a quantity is in a log, as its user assigns it, and how it becomes SI and NED.

`attitude=/sensor/attitude:angular?frame=ned&unit=deg` takes the field `angular` of a topic's
messages. A place is a topic and fields in bags and ULogs (``/imu/data:orientation``,
``vehicle_odometry:velocity``), a message and columns in DataFlash logs (``BARO:Alt``), and columns
in a CSV (``roll,pitch,yaw``). Options: `unit`, then `factor` and `offset` (factor v + offset), and
`frame`, which is `ros` (ENU and FLU, REP 103) or `ned` (NED and FRD).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from types import MappingProxyType
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.bridge.ros2.frames import body, euler_angles, from_quaternion, world
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.units import parse_unit, value_conversion
from uuvsim_cosim.studies.identification.vehicle_log import SIZES, Series, without_repetitions

__all__ = ["NONE", "QUANTITIES", "Channel", "assigned", "channel_of", "in_ned", "read_channels"]

Array = NDArray[np.float64]
Read = Callable[["Channel"], tuple[Array, Array]]
_FRAMES = ("ros", "ned")
# Unit of each quantity that has one.
QUANTITIES = {
    "attitude": "rad", "rates": "rad/s", "position": "m", "velocity": "m/s", "dvl": "m/s",
    "depth": "m", "range": "m", "voltage": "V", "u": "1", "armed": "1",
}  # fmt: skip
_TURNED = ("attitude", "rates", "position", "velocity", "dvl", "tau")


@dataclass(frozen=True)
class Channel:
    """A quantity of a log, its place there, and its conversion to SI units and NED."""

    series: str
    place: str
    factor: float = 1.0
    offset: float = 0.0
    frame: str | None = None  # ros or ned; None: as usual in the format
    unit: str | None = None  # of the numbers, as it is assigned

    def __str__(self) -> str:
        """Return it as it is assigned."""
        return f"--channel {self.series}={self.place}"

    @property
    def is_turned(self) -> bool:
        """Whether the frame matters to the quantity."""
        return self.series in _TURNED

    @property
    def topic(self) -> str:
        """Return the place without its fields."""
        return self.place.partition(":")[0]

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the fields behind the topic, or none."""
        return tuple(f.strip() for f in self.place.partition(":")[2].split(",") if f.strip())


NONE: Mapping[str, Channel] = MappingProxyType({})


def channel_of(text: str, place: str) -> Channel:
    """Read ``series=place?options``; raises InputInvalid that names `place`."""
    name, equals, rest = (part.strip() for part in text.partition("="))
    where, _, query = rest.partition("?")
    if not equals or not where:
        raise InputInvalid(f"{place} {text}: expected quantity=topic:field, or a YAML file")
    if name not in SIZES:
        names = expected_names(name, list(SIZES))
        raise InputInvalid(f"{place} {text}", f"{name!r} is no quantity", names)
    options = dict(parse_qsl(query, keep_blank_values=True))
    for key in options.keys() - {"unit", "factor", "offset", "frame"}:
        raise InputInvalid(f"{place} {text}", f"option {key!r}", "unit, factor, offset or frame")
    frame = options.get("frame")
    if frame is not None and frame not in _FRAMES:
        raise InputInvalid(f"{place} {text}", f"frame={frame}", " or ".join(_FRAMES))
    numbers = {}
    for key in ("factor", "offset"):
        try:
            numbers[key] = float(options.get(key, key == "factor"))
        except ValueError:
            raise InputInvalid(f"{place} {text}", f"{key}={options[key]}", "a number") from None
    unit = options.get("unit")
    to_si, zero = (1.0, 0.0) if unit is None else _in_si(name, unit, f"{place} {text}")
    factor, offset = numbers["factor"], numbers["offset"]
    return Channel(name, where, factor * to_si, factor * zero + offset, frame, unit)


def _in_si(series: str, unit: str, place: str) -> tuple[float, float]:
    wanted = QUANTITIES.get(series)
    if wanted is None:
        raise InputInvalid(place, f"{series} has no unit to choose", "factor and offset")
    try:
        found = value_conversion(parse_unit(unit), parse_unit(wanted))
    except ValueError:
        found = None
    if found is None:
        raise InputInvalid(place, f"unit={unit}", f"a unit of {wanted}")
    return found


def read_channels(texts: Sequence[str]) -> dict[str, Channel]:
    """Read channels from assignments, and from YAML files of lines ``quantity: place?options``."""
    found: dict[str, Channel] = {}
    for text in texts:
        is_file = "=" not in text
        given = _file(Path(text)) if is_file else [(text, "--channel")]
        for line, place in given:
            channel = channel_of(line, place)
            if channel.series in found:
                raise InputInvalid(f"{place} {line}", f"{channel.series} is given twice", "once")
            found[channel.series] = channel
    return found


def _file(path: Path) -> list[tuple[str, str]]:
    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedMap
    from ruamel.yaml.error import YAMLError

    try:
        data = YAML(typ="rt", pure=True).load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        shown = str(error).splitlines()[0]
        raise InputInvalid(path, f"cannot be read ({shown})", "a YAML file of channels") from None
    if not isinstance(data, CommentedMap) or not all(isinstance(v, str) for v in data.values()):
        raise InputInvalid(path, "is no table of texts", "lines such as attitude: /imu/data")
    return [(f"{k}={v}", f"{path}:{data.lc.key(k)[0] + 1}:") for k, v in data.items()]


def assigned(
    path: Path, channels: Mapping[str, Channel], read: Read, *, frame: str = "ned"
) -> dict[str, Series]:
    """Return the series of channels, each read by `read` as times (n,) and numbers (n, k)."""
    found = {}
    for name, channel in channels.items():
        t, values = read(channel)
        keep = np.isfinite(values).any(axis=1)
        if not keep.any():
            raise InputInvalid(f"{path}: {channel}", "no number", "at least one")
        wanted = (SIZES[name],) if name != "attitude" else (3, 4)
        if wanted != (None,) and values.shape[1] not in wanted:
            expected = " or ".join(map(str, wanted))
            raise InputInvalid(f"{path}: {channel}", f"{values.shape[1]} numbers", expected)
        numbers = channel.factor * values[keep] + channel.offset
        numbers = in_ned(name, numbers, channel.frame or frame)
        found[name] = without_repetitions(path, channel.place, t[keep], numbers)
    return found


def in_ned(series: str, values: Array, frame: str) -> Array:
    """Return a series in NED and FRD; a quaternion (n, 4) is x y z w and becomes Euler angles."""
    if series not in _TURNED or (frame == "ned" and values.shape[1] != 4):
        return values
    if values.shape[1] == 4:
        q = values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-12)
        turned: Array = euler_angles(from_quaternion(q) if frame == "ros" else q[:, [3, 0, 1, 2]])
        return turned
    if series == "attitude":
        yaw = pi / 2 - values[:, 2]
        return np.stack([values[:, 0], -values[:, 1], (yaw + pi) % (2 * pi) - pi], axis=1)
    if series == "tau":
        return np.hstack([body(values[:, :3]), body(values[:, 3:])])
    return np.asarray(world(values) if series in ("position", "velocity") else body(values))
