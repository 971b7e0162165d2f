"""The ROS side of a node: publishers and clients as rmw_zenoh has them, by plain Zenoh."""

from __future__ import annotations

import json
import queue
import struct
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import zenoh

from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.ros2.interfaces import with_services
from uuvsim_cosim.bridge.ros2.topic_writer import typestore

STORE = with_services(typestore("jazzy"))
GID = bytes(range(16))


@contextmanager
def ros(
    port: int, tls: Mapping[str, object] | None = None, mode: str = "peer"
) -> Iterator[zenoh.Session]:
    """Open a session as rmw_zenoh does: a peer that connects to the router of its machine.

    The `mode` router is that router itself; it reaches another machine by `tls`.
    """
    kind = "tcp" if tls is None else "tls"
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("connect/endpoints", json.dumps([f"{kind}/127.0.0.1:{port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    if mode == "router":
        config.insert_json5("listen/endpoints", json.dumps(["tcp/127.0.0.1:0"]))
    if tls is not None:
        config.insert_json5("transport/link/tls", json.dumps(tls))
    with zenoh.open(config) as session:
        yield session


def tokens(session: zenoh.Session) -> list[str]:
    replies = session.liveliness().get("@ros2_lv/**", timeout=PATIENCE)
    return sorted(str(r.ok.key_expr) for r in replies if r.ok is not None)


def made(type_: str, **fields: Any) -> Any:
    """Return a message whose other fields are zero or empty."""
    values = {}
    for name, (kind, detail) in STORE.fielddefs[type_][1]:
        if kind.name == "NAME":
            values[name] = made(detail)
        elif kind.name == "BASE":
            values[name] = "" if detail[0] == "string" else 0
        elif detail[0][0].name == "BASE" and detail[0][1][0] != "string":
            dtype = {"byte": "u1"}.get(detail[0][1][0], detail[0][1][0])
            values[name] = np.zeros(detail[1] if kind.name == "ARRAY" else 0, dtype)
        else:
            values[name] = []
    return STORE.types[type_](**(values | fields))


def vector(x: float, y: float, z: float) -> Any:
    return made("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def twist(linear: tuple[float, float, float], angular: tuple[float, float, float]) -> Any:
    return made("geometry_msgs/msg/Twist", linear=vector(*linear), angular=vector(*angular))


def pose(position: tuple[float, float, float], q: tuple[float, float, float, float]) -> Any:
    point = dict(zip("xyz", position, strict=True))
    return made(
        "geometry_msgs/msg/Pose",
        position=made("geometry_msgs/msg/Point", **point),
        orientation=made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", q, strict=True))),
    )


def header(frame: str, stamp: float = 0.0) -> Any:
    sec = int(stamp)
    at = made("builtin_interfaces/msg/Time", sec=sec, nanosec=int((stamp - sec) * 1e9))
    return made("std_msgs/msg/Header", frame_id=frame, stamp=at)


def dds(type_: str) -> str:
    package, middle, name = type_.split("/")
    return f"{package}::{middle}::dds_::{name}_"


class Publisher:
    """A publisher of a topic, which numbers its messages from 1."""

    def __init__(self, session: zenoh.Session, topic: str, type_: str, hash_: str = "") -> None:
        self._type, self._number = type_, 0
        key = f"0/{topic[1:]}/{dds(type_)}/{hash_ or STORE.hash_rihs01(type_)}"
        self._raw = session.declare_publisher(key)

    def put(self, message: Any) -> None:
        self.put_bytes(bytes(STORE.serialize_cdr(message, self._type)))

    def put_bytes(self, data: bytes) -> None:
        self._number += 1
        attached = struct.pack("<qqB", self._number, time.time_ns(), 16) + GID
        self._raw.put(data, attachment=attached)


def call(
    session: zenoh.Session, name: str, type_: str, request: Any = None, number: int = 1
) -> tuple[Any, bytes]:
    """Call a service; return its response and what is attached to it."""
    replies = asked(session, name, type_, request, number)
    assert len(replies) == 1, replies
    [reply] = replies
    assert reply.ok is not None, reply.err
    assert reply.ok.attachment is not None
    response = STORE.deserialize_cdr(reply.ok.payload.to_bytes(), f"{type_}_Response")
    return response, reply.ok.attachment.to_bytes()


def asked(
    session: zenoh.Session, name: str, type_: str, request: Any = None, number: int = 1
) -> list[zenoh.Reply]:
    """Return what answers a call of a service."""
    if request is None:
        request = made(f"{type_}_Request")
    data = bytes(STORE.serialize_cdr(request, f"{type_}_Request"))
    attached = struct.pack("<qqB", number, time.time_ns(), 16) + GID
    return list(
        session.get(
            f"0/{name[1:]}/{dds(type_)}/{STORE.hash_rihs01(type_)}",
            payload=data,
            attachment=attached,
            target=zenoh.QueryTarget.ALL_COMPLETE,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=PATIENCE,
        )
    )


class Said:
    """Reports of a node, in order."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.texts: list[str] = []

    def __call__(self, text: str) -> None:
        self.texts.append(text)
        self._queue.put(text)

    def next(self) -> str:
        return self._queue.get(timeout=PATIENCE)
