"""A running system as a node of ROS 2, which machines with rmw_zenoh see and subscribe to."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, final

import numpy as np

from uuvsim_cosim.bridge.access.access_file import Access
from uuvsim_cosim.bridge.access.zenoh_permissions import endpoints
from uuvsim_cosim.bridge.ros2.cdr import MessageLayout
from uuvsim_cosim.bridge.ros2.ends import Ends, Reports
from uuvsim_cosim.bridge.ros2.facts import Facts, Place, facts_of
from uuvsim_cosim.bridge.ros2.frames import Array
from uuvsim_cosim.bridge.ros2.inputs import Input, System, inputs_of, read_inputs
from uuvsim_cosim.bridge.ros2.interfaces import with_services
from uuvsim_cosim.bridge.ros2.permissions import guarded_node
from uuvsim_cosim.bridge.ros2.receiver import Receiver
from uuvsim_cosim.bridge.ros2.rmw_zenoh import (
    Entity,
    attachment,
    gid,
    namesakes,
    node_token,
    qos_text,
)
from uuvsim_cosim.bridge.ros2.robot import STRING, mounted, robots_of, text_message
from uuvsim_cosim.bridge.ros2.rows import Layout
from uuvsim_cosim.bridge.ros2.services import Services
from uuvsim_cosim.bridge.ros2.topic_writer import TRANSFORMS, TopicWriter, typestore
from uuvsim_cosim.bridge.ros2.topics import (
    LATCHED,
    QosProfile,
    Topic,
    omitted_topics,
    read_topics,
    topics_of,
)
from uuvsim_cosim.bridge.ros2.waiting_rows import Part, WaitingRows
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

__all__ = ["ROUTER_PORT", "Ros2Node"]

ROUTER_PORT = 7447  # of rmw_zenohd
CLOCK = "rosgraph_msgs/msg/Clock"
_HERE = ("127.0.0.1",)
# Nodes of rmw_zenoh find each other by gossip; the cache of latched topics needs time stamps.
_SETTINGS: dict[str, object] = {"scouting/gossip/enabled": True, "timestamping/enabled": True}
_PACE = 0.002  # [s] between two looks at the rows of a system that steps faster
_LOOK = 0.1  # [s] between two checks which topics have a subscriber


@final
class Ros2Node(Owner):
    """A system as a node of ROS 2: topics, inputs, services, parameters; until `close`.

    It connects to the router of rmw_zenoh on this machine, or is that router if none is there; with
    port 0 it is the router at any free port, which the attribute `port` then holds. The
    topics follow from the signals, or from the file `topics`. Each topic is published while it has
    a subscriber; a subscriber that is slow loses messages and never delays the system. The node is
    called `name`, by default as the system, in `domain` (default: ROS_DOMAIN_ID, or 0).

    Topics, inputs and services have no authentication; without `commands`, inputs and services are
    not opened. With an `access` that has an authority of certificates, the node is a router that
    listens at `hosts` with mutual TLS, and the role of a peer's certificate determines what the
    peer may read, set and call. `resume` runs the system at `factor` of real time. Faults of other
    nodes are passed to `report` and kept in `reports`; none of them ends the node. `origin` is the
    place of the origin of `n`, which positions on Earth need. Raises InputInvalid without the extra
    ``ros``, for an unknown distribution, for mistakes in `topics`, and if another program uses the
    port.
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
        commands: bool = True,
        access: Access | None = None,
        hosts: Sequence[str] = _HERE,
        factor: float = 1.0,
        report: Callable[[str], None] = lambda text: None,
        origin: Place | None = None,
    ) -> None:
        store = with_services(typestore(distribution))
        self._file, self._conductor, self._origin = topics, conductor, origin
        self.domain = _domain() if domain is None else domain
        self.topics = list[Topic]()
        self.without_topic: list[str] = []  # texts
        self.omitted: list[str] = []  # messages that are not published, and why
        self._publishing: _Publishing | None = None
        self._rows = WaitingRows[_Publishing]()
        self._wake, self._over = threading.Event(), threading.Event()
        with self._opening() as opened:
            given = name or _node_name(str(conductor.describe()["system"]))
            if access is None:
                session, self.is_router = _session(port)
            else:
                settings = _SETTINGS | guarded_node(access, self.domain, given)
                session, self.is_router = listening(port, hosts, settings, tls=True), True
            opened.callback(session.close)
            self.port = session.port if self.is_router else port
            self.addresses = endpoints(hosts if access else _HERE, self.port, tls=bool(access))
            self.node = Entity(given, str(session.raw.zid()), domain=self.domain)
            self._token = session.token(node_token(self.node))
            self.reports = Reports(report)
            self._connected = True
            self._ends = Ends(
                session, store, self.node, distribution != "humble", self.reports
            )  # fmt: skip
            self._namesakes = session.watch(namesakes(self.node), self._noticed)
            self._thread = started("uuvsim-ros2", self._drain)
            opened.callback(self._end)
            conductor.watch(self)
            opened.callback(self._leave)
            self._receiver = self._services = None
            if commands:
                self._receiver = opened.enter_context(
                    Receiver(conductor, self._ends, self._chosen, self._published)
                )
                self._services = Services(conductor, self._ends, factor)

    @property
    def inputs(self) -> list[Input]:
        """The topics that set inputs of the system."""
        return [] if self._receiver is None else self._receiver.inputs

    @property
    def services(self) -> dict[str, str]:
        """The types of the services by name."""
        return {} if self._services is None else self._services.names

    def _chosen(self, system: System) -> list[Input]:
        return inputs_of(system) if self._file is None else read_inputs(self._file, system)

    def _published(self) -> tuple[str, ...]:
        return tuple(topic.name for topic in self.topics)

    # ---- the observer, in the conductor's thread ------------------------------------------

    def begin(self, plan: Plan, columns: Sequence[Column]) -> None:
        """Declare the topics of a new run."""
        layout, facts = Layout(columns, plan.tick), facts_of(plan, self._origin)
        self.without_topic, kinds = list(layout.texts), layout.variables
        if self._file is None:
            chosen, self.omitted = topics_of(kinds, facts), omitted_topics(kinds, facts)
        else:
            chosen = read_topics(self._file, kinds, facts)
        self.topics = chosen
        self._publishing = _Publishing(self._ends, chosen, facts, plan, layout, self._publishing)

    def observe(self, chunk: Chunk) -> None:
        """Note the newest rows; never wait."""
        publishing = self._publishing
        if publishing is not None:
            self._rows.add(publishing, chunk)
            if publishing.is_wanted:
                self._wake.set()

    def end(self) -> None:
        """Do nothing: `close` ends the node."""

    @property
    def dropped(self) -> int:
        """Rows that were not published, because the thread that publishes was slower."""
        return self._rows.dropped

    # ---- other nodes and the router ---------------------------------------------------------

    def _noticed(self, token: str, alive: bool) -> None:
        """Report another node of this node's name."""
        if alive and token != node_token(self.node):
            self.reports.once(
                f"/{self.node.name}", "name", "another node in domain "
                f"{self.node.domain} has this name; expected one node of a name, for example by "
                "another ROS_DOMAIN_ID",
            )  # fmt: skip

    def _check_router(self) -> None:
        """Report a router that has disappeared, once for each loss; Zenoh connects again."""
        connected = self.is_router or self._ends.session.is_connected
        if connected != self._connected:
            place = f"router tcp/127.0.0.1:{self.port}"
            self.reports.put(
                f"{place}: is there again" if connected else f"{place}: has disappeared; the "
                "simulation goes on, and the node connects again once it is there"
            )  # fmt: skip
        self._connected = connected

    # ---- the thread that publishes ----------------------------------------------------------

    def _drain(self) -> None:
        looked = 0.0
        while not self._over.is_set():
            self._wake.wait(_LOOK)
            self._wake.clear()
            begun = time.monotonic()
            if begun - looked >= _LOOK:
                looked = begun
                self._check_router()
                if (publishing := self._publishing) is not None:
                    publishing.look()
            for part in self._rows.take():
                part.run.publish(part, self._rows)
            # Two rows in one block cost as much as one.
            self._over.wait(_PACE - (time.monotonic() - begun))

    def _leave(self) -> None:
        with contextlib.suppress(InputInvalid):  # the co-simulation has ended already
            self._conductor.unwatch(self)

    def _end(self) -> None:
        self._over.set()
        self._wake.set()
        self._thread.join()


class _Publishing:
    """Publishers of one run; those of the run before are kept for topics that stay."""

    def __init__(
        self,
        ends: Ends,
        topics: Sequence[Topic],
        facts: Facts,
        plan: Plan,
        layout: Layout,
        before: _Publishing | None,
    ) -> None:
        self._ends, self._layout = ends, layout
        self.made: dict[str, _Publisher] = {} if before is None else before.made
        self._writers = [TopicWriter(topic, ends.store, facts) for topic in topics]
        self._clock = MessageLayout(ends.store, CLOCK, {}, {})
        robots = robots_of(plan, facts)
        static = mounted(ends.store, topics, robots)
        qos = {topic.name: topic.qos for topic in topics}
        for name, type_ in [("/clock", CLOCK), *((t.name, t.type) for t in topics)]:
            self._publisher(name, type_, qos.get(name, QosProfile()))
        if len(static):
            self._publisher("/tf_static", TRANSFORMS, LATCHED, once=True).put(static.tobytes())
        for robot in robots:
            text = text_message(ends.store, robot.urdf)
            self._publisher(robot.topic, STRING, LATCHED, once=True).put(text.tobytes())
        self._wanted: frozenset[str] = frozenset()

    def look(self) -> None:
        """Notice which topics have a subscriber."""
        self._wanted = frozenset(name for name, p in self.made.items() if p.is_wanted)

    @property
    def is_wanted(self) -> bool:
        """Whether a topic has a subscriber."""
        return bool(self._wanted)

    def publish(self, part: Part[_Publishing], rows: WaitingRows[_Publishing]) -> None:
        """Publish rows, for the topics that are wanted."""
        if not self._wanted:
            return
        block = self._layout.rows(part.ticks, part.slots)
        if "/clock" in self._wanted:
            stamps = np.rint(block.time * 1e9).astype(np.int64)
            self._put("/clock", self._clock.rows(len(stamps), {
                "clock.sec": stamps // 10**9, "clock.nanosec": stamps % 10**9,
            }))  # fmt: skip
        for writer in self._writers:
            if writer.topic.name in self._wanted and not writer.rests(block):
                messages = writer.messages(block)[1]
                if not rows.is_intact(part):  # the master came round while they were made
                    return
                self._put(writer.topic.name, messages)

    def _put(self, name: str, messages: Iterable[Array]) -> None:
        publisher = self.made[name]
        for message in messages:
            publisher.put(message.tobytes())

    def _publisher(
        self, name: str, type_: str, qos: QosProfile, *, once: bool = False
    ) -> _Publisher:
        if name not in self.made:
            self.made[name] = _Publisher(self._ends, name, type_, qos, once=once)
        return self.made[name]


class _Publisher:
    """A publisher of one topic, with its token, which must be kept.

    One that publishes `once` does not look for subscribers. A publisher that keeps messages for
    later subscribers has to publish without one.
    """

    def __init__(self, ends: Ends, name: str, type_: str, qos: QosProfile, *, once: bool) -> None:
        self._raw: Any = _publisher(ends.session, ends.key(name, type_), qos)
        self._once, self._keeps = once, qos.transient_local
        token = ends.token("MP", name, type_, qos_text(**qos._asdict()))
        self._gid, self._token = gid(token), ends.session.token(token)
        self._number = 0

    @property
    def is_wanted(self) -> bool:
        """Whether there is a subscriber, or there may be one later."""
        return not self._once and (self._keeps or bool(self._raw.matching_status.matching))

    def put(self, message: bytes) -> None:
        """Publish a message now."""
        self._number += 1
        self._raw.put(message, attachment=attachment(self._number, time.time_ns(), self._gid))


def _session(port: int) -> tuple[WrappedSession, bool]:
    """Return a session with the router at a port of this machine, or the router's itself."""
    try:
        if port:
            return connecting("127.0.0.1", port, _SETTINGS), False
    except NoSession:
        raise InputInvalid(
            f"ROS 2: port {port} of this machine is in use by another program",
            "the router of rmw_zenoh there, or nothing",
        ) from None
    except Disconnected:
        pass
    return listening(port, settings=_SETTINGS), True


def _publisher(session: WrappedSession, key: str, qos: QosProfile) -> Any:
    """Return a publisher; the last messages of one that keeps them reach later subscribers."""
    if not qos.transient_local:
        return session.publisher(key, best_effort=qos.best_effort)
    from zenoh import CongestionControl, Priority, Reliability, ext

    return ext.declare_advanced_publisher(
        session.raw, key, cache=ext.CacheConfig(max_samples=qos.depth or 42),
        publisher_detection=True, congestion_control=CongestionControl.DROP,
        priority=Priority.DATA_LOW,
        reliability=Reliability.BEST_EFFORT if qos.best_effort else Reliability.RELIABLE,
    )  # fmt: skip


def _domain() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "0") or "0"
    if not text.isdecimal() or int(text) > 232:
        raise InputInvalid(f"ROS_DOMAIN_ID {text!r}", "a number from 0 to 232")
    return int(text)


def _node_name(system: str) -> str:
    name = "".join(c if c.isascii() and c.isalnum() else "_" for c in system)
    return name if name[:1].isalpha() else f"uuvsim_{name}"
