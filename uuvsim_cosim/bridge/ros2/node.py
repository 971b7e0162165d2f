"""A running system as a node of ROS 2, which machines with rmw_zenoh see and subscribe to."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from uuvsim_cosim.bridge.ros2.cdr import MessageLayout
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.rmw_zenoh import (
    Entity,
    attachment,
    gid,
    node_token,
    topic_key,
    topic_token,
)
from uuvsim_cosim.bridge.ros2.rows import Layout
from uuvsim_cosim.bridge.ros2.topic_writer import (
    TRANSFORMS,
    TopicWriter,
    mounted,
    parameters_of,
    typestore,
)
from uuvsim_cosim.bridge.ros2.topics import Topic, read_topics, topics_of
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.zenoh.session import (
    Disconnected,
    NoSession,
    WrappedSession,
    connecting,
    listening,
)
from uuvsim_cosim.closing import Owner, started
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.observer import Chunk, Column
from uuvsim_cosim.orchestrator.plan.plan import Plan

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

__all__ = ["ROUTER_PORT", "Ros2Node"]

ROUTER_PORT = 7447  # of rmw_zenohd
CLOCK = "rosgraph_msgs/msg/Clock"
_CHUNKS = 256  # chunks of rows that wait at most; older ones are dropped
_ROWS = 64  # of a chunk at most: a run that is as fast as possible sends its newest rows
_LOOK = 0.1  # [s] between two checks which topics have a subscriber


@final
class Ros2Node(Owner):
    """Publisher of a system's signals as ROS 2 topics, from construction to `close`.

    It connects to the router of rmw_zenoh on this machine, or is that router if none is there. The
    topics follow from the signals, or from the file `topics`. Each topic is published while it has
    a subscriber; a subscriber that is slow loses messages and never delays the system. The node is
    called `name`, by default as the system, in `domain` (default: ROS_DOMAIN_ID, or 0). Raises
    InputInvalid without the extra ``ros``, for an unknown distribution, for mistakes in `topics`,
    and if another program uses the port.
    """

    def __init__(
        self,
        conductor: Conductor,
        distribution: str = "jazzy",
        *,
        topics: Path | None = None,
        name: str | None = None,
        domain: int | None = None,
        port: int = ROUTER_PORT,
    ) -> None:
        store = typestore(distribution)
        self._file, self._conductor = topics, conductor
        self.domain = _domain() if domain is None else domain
        self.port, self.topics, self.dropped = port, list[Topic](), 0
        self.without_topic: list[str] = []  # texts
        self._publishing: _Publishing | None = None
        self._ring: deque[tuple[_Publishing, Array, Array]] = deque(maxlen=_CHUNKS)
        self._wake, self._over = threading.Event(), False
        with self._opening() as opened:
            session, self.is_router = _session(port)
            opened.callback(session.close)
            given = name or _node_name(str(conductor.describe()["system"]))
            self.node = Entity(given, str(session.raw.zid()), domain=self.domain)
            self._token = session.token(node_token(self.node))
            self._ends = _Ends(session, store, self.node, hashed=distribution != "humble")
            self._thread = started("uuvsim-ros2", self._drain)
            opened.callback(self._end)
            conductor.watch(self)
            opened.callback(self._leave)

    # ---- the observer, in the conductor's thread ------------------------------------------

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Declare the topics of a new run."""
        layout = Layout(columns, plan.tick)
        self.without_topic = list(layout.texts)
        kinds = layout.variables
        self.topics = topics_of(kinds) if self._file is None else read_topics(self._file, kinds)
        self._publishing = _Publishing(self._ends, self.topics, plan, layout, self._publishing)

    def observe(self, chunk: Chunk) -> None:
        """Copy the newest rows; never wait."""
        publishing = self._publishing
        if publishing is None:
            return
        rows = chunk.rows[-_ROWS:]
        self.dropped += len(chunk.rows) - len(rows)
        self._ring.append((publishing, chunk.ticks[-_ROWS:].copy(), rows.copy()))
        self._wake.set()

    def end(self) -> None:
        """Do nothing: `close` ends the node."""

    # ---- the thread that publishes ----------------------------------------------------------

    def _drain(self) -> None:
        looked = 0.0
        while not self._over:
            self._wake.wait(_LOOK)
            self._wake.clear()
            look = time.monotonic() - looked >= _LOOK
            if look:
                looked = time.monotonic()
                if (publishing := self._publishing) is not None:
                    publishing.look()
            while self._ring and not self._over:
                with contextlib.suppress(IndexError):
                    publishing, ticks, rows = self._ring.popleft()
                    publishing.publish(ticks, rows)

    def _leave(self) -> None:
        with contextlib.suppress(InputInvalid):  # the co-simulation has ended already
            self._conductor.unwatch(self)

    def _end(self) -> None:
        self._over = True
        self._wake.set()
        self._thread.join()


@dataclass(frozen=True)
class _Ends:
    """What publishers share: their session, their node, and the messages of the distribution."""

    session: WrappedSession
    store: Typestore
    node: Entity
    hashed: bool  # False in humble, whose types have no hash

    def hash_of(self, type_: str) -> str:
        """Return the hash of a type of message, as it stands in keys."""
        return self.store.hash_rihs01(type_) if self.hashed else "TypeHashNotSupported"


class _Publishing:
    """Publishers of one run; those of the run before are kept for topics that stay."""

    def __init__(
        self,
        ends: _Ends,
        topics: Sequence[Topic],
        plan: Plan,
        layout: Layout,
        before: _Publishing | None,
    ) -> None:
        self._ends, self._layout = ends, layout
        parameters = parameters_of(plan, {topic.component for topic in topics})
        self.made: dict[str, _Publisher] = {} if before is None else before.made
        self._writers = [TopicWriter(topic, ends.store, parameters) for topic in topics]
        self._clock = MessageLayout(ends.store, CLOCK, {}, {})
        static = mounted(ends.store, topics, parameters)
        for name, type_ in [("/clock", CLOCK), *((t.name, t.type) for t in topics)]:
            self._publisher(name, type_)
        if len(static):
            self._publisher("/tf_static", TRANSFORMS, latched=True).put(static.tobytes())
        self._wanted: frozenset[str] = frozenset()

    def look(self) -> None:
        """Notice which topics have a subscriber."""
        self._wanted = frozenset(name for name, p in self.made.items() if p.is_wanted)

    def publish(self, ticks: Array, rows: Array) -> None:
        """Publish rows, for the topics that are wanted."""
        block = self._layout.rows(ticks, rows)
        if "/clock" in self._wanted:
            stamps = np.rint(block.time * 1e9).astype(np.int64)
            messages = self._clock.rows(len(stamps), {
                "clock.sec": stamps // 10**9, "clock.nanosec": stamps % 10**9,
            })  # fmt: skip
            self._put("/clock", messages)
        for writer in self._writers:
            if writer.topic.name in self._wanted:
                self._put(writer.topic.name, writer.messages(block)[1])

    def _put(self, name: str, messages: Array) -> None:
        publisher = self.made[name]
        for message in messages:
            publisher.put(message.tobytes())

    def _publisher(self, name: str, type_: str, *, latched: bool = False) -> _Publisher:
        if name not in self.made:
            self.made[name] = _Publisher(
                self._ends, len(self.made) + 1, name, type_, latched=latched
            )
        return self.made[name]


class _Publisher:
    """A publisher of one topic, with its token, which must be kept."""

    def __init__(self, ends: _Ends, number: int, name: str, type_: str, *, latched: bool) -> None:
        node, session, hash_ = ends.node, ends.session, ends.hash_of(type_)
        key = topic_key(node.domain, name, type_, hash_)
        self._raw: Any = _latched(session, key) if latched else session.publisher(key)
        self._is_latched = latched
        token = topic_token(node, number, name, type_, hash_, latched=latched)
        self._gid, self._token = gid(token), session.token(token)
        self._number = 0

    @property
    def is_wanted(self) -> bool:
        """Whether there is a subscriber."""
        return not self._is_latched and bool(self._raw.matching_status)

    def put(self, message: bytes) -> None:
        """Publish a message now."""
        self._number += 1
        self._raw.put(message, attachment=attachment(self._number, time.time_ns(), self._gid))


def _session(port: int) -> tuple[WrappedSession, bool]:
    """Return a session with the router at a port of this machine, or the router's itself."""
    settings = {"scouting/gossip/enabled": True}  # nodes of rmw_zenoh find each other by it
    try:
        return connecting("127.0.0.1", port, settings), False
    except NoSession:
        raise InputInvalid(
            f"ROS 2: port {port} of this machine is in use by another program",
            "the router of rmw_zenoh there, or nothing",
        ) from None
    except Disconnected:
        return listening(port, settings=settings), True


def _latched(session: WrappedSession, key: str) -> Any:
    """Return a publisher whose last message reaches later subscribers (transient local)."""
    from zenoh import ext

    cache = ext.CacheConfig(max_samples=1)
    return ext.declare_advanced_publisher(session.raw, key, cache=cache, publisher_detection=True)


def _domain() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "0") or "0"
    if not text.isdecimal() or int(text) > 232:
        raise InputInvalid(f"ROS_DOMAIN_ID {text!r}", "a number from 0 to 232")
    return int(text)


def _node_name(system: str) -> str:
    name = "".join(c if c.isascii() and c.isalnum() else "_" for c in system)
    return name if name[:1].isalpha() else f"uuvsim_{name}"
