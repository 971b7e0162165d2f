"""Signals as channels of Foxglove: each makes messages from rows while it has a subscriber.

A component's signals are one JSON message, in the project's names, units and frames; its schema
states type, unit and meaning of each. Poses, transforms and fixes have Foxglove's own schemas, and
the frames of ROS: `map` is ENU, `base_link` is FLU.
"""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, final

import numpy as np

from uuvsim_cosim.bridge.calls.values import json_of, json_texts
from uuvsim_cosim.bridge.foxglove.georeference import Georeference
from uuvsim_cosim.bridge.ros2.facts import facts_of
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.robot import Part, robots_of
from uuvsim_cosim.bridge.ros2.rows import Block, Layout
from uuvsim_cosim.bridge.ros2.topic_writer import TRANSFORMS, TopicColumns
from uuvsim_cosim.bridge.ros2.topics import Topic, topics_of
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Form", "Message", "Output", "json_form", "nanoseconds", "outputs_of"]

_LARGE, _GAP = 1000, 0.1  # numbers of a large component, such as a camera; [s] between its messages
Message = tuple[int, bytes]  # simulated time [ns], data
# Types of ROS with a pose, and its path in the message.
_POSES = {
    "nav_msgs/msg/Odometry": "pose.pose",
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
}


class Form(NamedTuple):
    """Encoding of a channel's messages, and their schema."""

    encoding: str  # json or protobuf
    name: str
    schema_encoding: str
    schema: bytes


def json_form(schema: Mapping[str, object]) -> Form:
    """Return the form of JSON messages with a JSON schema, whose title is the name."""
    return Form("json", str(schema["title"]), "jsonschema", json.dumps(schema).encode())


class Output(ABC):
    """A channel: its topic, the form of its messages, and its messages for rows of signals."""

    topic: str
    form: Form

    @abstractmethod
    def messages(self, block: Block) -> Iterable[Message]:
        """Return the messages of some rows."""

    def whole(self, newest: Block) -> Iterable[Message]:
        """Return the messages that a new subscriber needs; by default those of the newest row."""
        return self.messages(newest)


def nanoseconds(time: Array) -> list[int]:
    """Return times [s] as Foxglove counts them; they are never negative."""
    stamps: list[int] = np.rint(np.maximum(time, 0.0) * 1e9).astype(np.int64).tolist()
    return stamps


def outputs_of(plan: Plan, layout: Layout, place: Georeference | None) -> list[Output]:
    """Return the channels of a system: all components, then poses, fixes and transforms."""
    variables: dict[str, dict[str, Variable]] = {}
    for column in layout.columns:
        variables.setdefault(column.path, {})[column.variable.name] = column.variable
    outputs: list[Output] = [_Component(path, held) for path, held in variables.items()]
    facts = facts_of(plan)
    topics = topics_of(layout.variables, facts)
    posed = [topic for topic in topics if topic.type in _POSES]
    outputs += [_Pose(topic) for topic in posed]
    if place is not None:
        outputs += [_Fix(topic, place) for topic in posed if "eta" in topic.signals]
    moving = [topic for topic in topics if topic.type == TRANSFORMS]
    fixed = [part for robot in robots_of(plan, facts) for part in robot.parts if part.kind != "fin"]
    return [*outputs, _Transforms(moving, fixed)]


@final
class _Component(Output):
    """All recorded signals of a component."""

    def __init__(self, path: str, variables: Mapping[str, Variable]) -> None:
        self.topic = "/" + path.replace(".", "/")
        self._shapes = {name: (f"{path}.{name}", v.shape) for name, v in variables.items()}
        self.form = json_form({
            "type": "object", "title": path,
            "properties": {name: _schema(v) for name, v in variables.items()},
        })  # fmt: skip

        self._size, self._next = sum(v.size for v in variables.values()), -np.inf

    def messages(self, block: Block) -> Iterator[Message]:
        if self._size > _LARGE:
            if time.monotonic() >= self._next:
                self._next = time.monotonic() + _GAP
                yield from self.whole(block)
            return
        columns = []
        for full, shape in self._shapes.values():
            values = np.asarray(block[full])
            values = values.reshape(len(values), *shape)
            plain = values.dtype.kind in "iub" or (
                values.dtype.kind == "f" and bool(np.isfinite(values).all())
            )
            columns.append(values.tolist() if plain else json_of(values))
        names = list(self._shapes)
        for at, row in zip(nanoseconds(block.time), zip(*columns, strict=True), strict=True):
            message = dict(zip(names, row, strict=True))
            yield at, json.dumps(message, separators=(",", ":"), allow_nan=False).encode()

    def whole(self, newest: Block) -> Iterator[Message]:
        [at] = nanoseconds(newest.time[-1:])
        row = {
            name: np.reshape(np.asarray(newest[full])[-1], shape)
            for name, (full, shape) in self._shapes.items()
        }
        yield at, "".join(json_texts(row)).encode()


def _schema(variable: Variable) -> dict[str, object]:
    """Return the JSON schema of a variable: NaN and infinite numbers are sent as null."""
    kind = {"Boolean": "boolean", "String": "string", "Binary": "string"}.get(variable.type)
    integer = variable.type.startswith(("Int", "UInt", "Enum"))
    schema: dict[str, object] = {"type": kind or ("integer" if integer else "number")}
    for size in reversed(variable.shape):
        schema = {"type": "array", "items": schema, "minItems": size, "maxItems": size}
    units = [u or "1" for u in variable.element_units or (variable.unit,)]
    if kind is None:
        schema["unit"] = ", ".join(dict.fromkeys(units))
        schema["description"] = f"{variable.description} [{schema['unit']}]".strip()
    elif variable.description:
        schema["description"] = variable.description
    return schema


class _Typed(Output):
    """A channel of one of Foxglove's own types, as Protobuf."""

    def __init__(self, topic: str, type_: str) -> None:
        from foxglove import messages

        self.topic, self._sdk = topic, messages
        schema = getattr(messages, type_).get_schema()
        self.form = Form("protobuf", schema.name, schema.encoding, schema.data)

    def _stamp(self, at: int) -> Any:
        return self._sdk.Timestamp(at // 10**9, at % 10**9)

    def _turned(self, q: Sequence[float]) -> Any:
        x, y, z, w = q
        return self._sdk.Quaternion(x=x, y=y, z=z, w=w)

    def _vector(self, p: Sequence[float]) -> Any:
        x, y, z = p
        return self._sdk.Vector3(x=x, y=y, z=z)


def _of_pose(columns: Mapping[str, Array], n: int, position: str, orientation: str) -> list[Any]:
    """Return position and orientation of each row that is finite, else None."""
    p = np.broadcast_to(columns[position], (n, 3))
    q = np.broadcast_to(columns.get(orientation, np.array([[0.0, 0.0, 0.0, 1.0]])), (n, 4))
    known = np.isfinite(p).all(axis=1) & np.isfinite(q).all(axis=1)
    pairs = zip(p.tolist(), q.tolist(), strict=True)
    return [pair if good else None for pair, good in zip(pairs, known.tolist(), strict=True)]


@final
class _Pose(_Typed):
    """A pose in `map`, of a hull, an estimate or a reference: foxglove.PoseInFrame."""

    def __init__(self, topic: Topic) -> None:
        super().__init__(f"/{topic.component.replace('.', '/')}/pose", "PoseInFrame")
        self._columns, self._frame = TopicColumns(topic, {}), topic.frame
        self._path = _POSES[topic.type]

    def messages(self, block: Block) -> Iterator[Message]:
        times, columns = self._columns.columns(block)
        if not columns:
            return
        sdk, path = self._sdk, self._path
        poses = _of_pose(columns, len(times), f"{path}.position", f"{path}.orientation")
        for at, pose in zip(nanoseconds(times), poses, strict=True):
            if pose is not None:
                held = sdk.Pose(position=self._vector(pose[0]), orientation=self._turned(pose[1]))
                message = sdk.PoseInFrame(
                    timestamp=self._stamp(at), frame_id=self._frame, pose=held
                )
                yield at, message.encode()


@final
class _Fix(_Typed):
    """Place on Earth of a hull or an estimate: foxglove.LocationFix; its altitude is -D."""

    def __init__(self, topic: Topic, place: Georeference) -> None:
        super().__init__(f"/{topic.component.replace('.', '/')}/fix", "LocationFix")
        self._eta, self._sigma, self._place = (
            topic.signals["eta"],
            topic.signals.get("sigma"),
            place,
        )

    def messages(self, block: Block) -> Iterator[Message]:
        kinds = self._sdk.LocationFixPositionCovarianceType
        eta = np.asarray(block[self._eta])
        places = self._place(eta[:, :2])
        for i, at in enumerate(nanoseconds(block.time)):
            if not np.isfinite([*eta[i, :3], *places[i]]).all():
                continue
            latitude, longitude = places[i].tolist()
            given: dict[str, Any] = {}
            if self._sigma is not None:
                north, east, down = np.square(np.asarray(block[self._sigma])[i, :3]).tolist()
                given["position_covariance"] = [east, 0.0, 0.0, 0.0, north, 0.0, 0.0, 0.0, down]
                given["position_covariance_type"] = kinds.DiagonalKnown
            message = self._sdk.LocationFix(
                timestamp=self._stamp(at), latitude=latitude, longitude=longitude,
                altitude=-float(eta[i, 2]), **given,
            )  # fmt: skip
            yield at, message.encode()


@final
class _Transforms(_Typed):
    """Frames of hulls in `map`, and of sensors in their hull: foxglove.FrameTransforms."""

    def __init__(self, moving: Sequence[Topic], mounts: Sequence[Part]) -> None:
        super().__init__("/tf", "FrameTransforms")
        self._moving, self._mounts = [TopicColumns(topic, {}) for topic in moving], mounts

    def messages(self, block: Block) -> Iterator[Message]:
        for columns in self._moving:
            times, found = columns.columns(block)
            at = "transforms.0.transform"
            poses = _of_pose(found, len(times), f"{at}.translation", f"{at}.rotation")
            topic = columns.topic
            for stamp, pose in zip(nanoseconds(times), poses, strict=True):
                if pose is not None:
                    yield self._message(stamp, [(topic.frame, topic.child, *pose)])

    def whole(self, newest: Block) -> Iterator[Message]:
        [stamp] = nanoseconds(newest.time)
        if self._mounts:
            yield self._message(stamp, [
                (m.above, m.name, m.r, m.q)
                for m in self._mounts
            ])  # fmt: skip
        yield from self.messages(newest)

    def _message(self, at: int, transforms: Iterable[tuple[str, str, Any, Any]]) -> Message:
        sdk = self._sdk
        made = [
            sdk.FrameTransform(
                timestamp=self._stamp(at), parent_frame_id=parent, child_frame_id=child,
                translation=self._vector(p), rotation=self._turned(q),
            )
            for parent, child, p, q in transforms
        ]  # fmt: skip
        return at, sdk.FrameTransforms(transforms=made).encode()
