"""Zenoh sessions with clear error messages, which close when the program ends."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, final

from uuvsim_cosim.bridge.access.zenoh_permissions import endpoints as endpoints_of
from uuvsim_cosim.bridge.zenoh.shared_memory import LARGE
from uuvsim_cosim.closing import Closing, close_at_exit
from uuvsim_cosim.errors import InputInvalid, UuvsimError

if TYPE_CHECKING:
    import zenoh

__all__ = [
    "PORT", "Disconnected", "NoSession", "WrappedSession", "connecting", "free_port", "listening",
]  # fmt: skip

PORT = 7470
_FOREVER = 10_000_000  # [s] that a query waits; a session that ends answers sooner
_PATIENCE = 5.0  # [s] that closing waits for threads that are inside Zenoh
_LARGEST = 64 << 20  # bytes of one message
_TRIES = 100  # free ports that are tried
_NONE: Mapping[str, object] = {}
# A client that does not read is disconnected. Half-open connections do not lock others out: each
# may wait for three seconds, and together they use at most half of the process's files.
_LISTENING = {
    "transport/unicast/max_sessions": 256,
    "transport/unicast/accept_timeout": 3000,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,
}


class Disconnected(UuvsimError):
    """The other end does not exist, or has disconnected."""

    exit_status = 3


class NoSession(Disconnected):
    """A server listens there, but opens no session to this client."""


@final
class WrappedSession(Closing):
    """An open session; `close_at_exit` closes it when the program ends.

    After `close`, no thread that this session started is inside Zenoh. Python ends daemon threads
    when they wait for its lock; inside Zenoh, that aborts the program ("exception not rethrown").
    """

    def __init__(self, session: zenoh.Session, port: int = 0) -> None:
        self.raw, self.port = session, port  # at which it listens, else 0
        self._idle = threading.Condition()
        self._inside = 0  # threads that wait within a call of Zenoh
        self._callbacks = 0  # threads of Zenoh, each of which ends with its callback
        self._ended: queue.SimpleQueue[threading.Thread] = queue.SimpleQueue()
        self._open = True
        close_at_exit(self)

    @property
    def is_open(self) -> bool:
        """Whether it has not been closed."""
        return self._open

    @property
    def is_connected(self) -> bool:
        """Whether another process is connected."""
        info = self.raw.info
        return bool(info.routers_zid() or info.peers_zid())

    @contextlib.contextmanager
    def inside(self) -> Iterator[None]:
        """Count a call of Zenoh that waits; raises Disconnected if the session is closed."""
        with self._idle:
            if not self._open:
                raise Disconnected("this connection is closed; expected an open one")
            self._inside += 1
        try:
            yield
        finally:
            with self._idle:
                self._inside -= 1
                self._idle.notify_all()

    def answer(
        self, key: str, answer: Callable[[zenoh.Query], None], *, complete: bool = False
    ) -> object:
        """Answer the queries on a key by a function, one after another in a thread.

        A query can ask for `complete` answers only. As for `token` and `watch`, the result must be
        kept: Zenoh ends with it.
        """
        return self.raw.declare_queryable(key, self._callback(answer), complete=complete)

    def asker(self, key: str, timeout: float = _FOREVER) -> zenoh.Querier:
        """Return a querier of a key, which waits for `timeout` s, by default without limit.

        It returns the only answer immediately: consolidation would wait for others.
        """
        import zenoh

        return self.raw.declare_querier(
            key, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE, express=True
        )

    def publisher(
        self, key: str, encoding: str = "zenoh/bytes", *, best_effort: bool = False
    ) -> zenoh.Publisher:
        """Return a publisher of states: messages that cannot be sent immediately are dropped.

        With `best_effort`, a link may lose further messages; a link by TCP loses none.
        """
        import zenoh

        return self.raw.declare_publisher(
            key,
            encoding=encoding,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
            reliability=zenoh.Reliability.BEST_EFFORT if best_effort else None,
        )

    def subscribe(
        self, key: str, keep: int
    ) -> zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]:
        """Subscribe to a key; the newest `keep` messages wait to be received."""
        import zenoh

        return self.raw.declare_subscriber(key, zenoh.handlers.RingChannel(keep))

    def token(self, key: str) -> object:
        """Declare that a key is alive, until this session ends."""
        return self.raw.liveliness().declare_token(key)

    def alive(self, key: str) -> list[str]:
        """List the keys that are alive now."""
        replies = self.raw.liveliness().get(key, timeout=5.0)
        return [str(r.ok.key_expr) for r in replies if r.ok is not None]

    def watch(self, key: str, changed: Callable[[str, bool], None]) -> object:
        """Call a function for each key that becomes alive (True) or is no longer alive (False)."""
        import zenoh

        def received(sample: zenoh.Sample) -> None:
            changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        return self.raw.liveliness().declare_subscriber(key, self._callback(received), history=True)

    def close(self) -> None:
        """Close the session; threads that wait for a message stop waiting."""
        with self._idle:
            was, self._open = self._open, False
        if not was:
            return
        with contextlib.suppress(Exception):  # the other end may be gone already
            self.raw.close()
        latest = time.monotonic() + _PATIENCE
        with self._idle:
            self._idle.wait_for(lambda: not self._inside, _PATIENCE)
        with contextlib.suppress(queue.Empty):
            for _ in range(self._callbacks):
                thread = self._ended.get(timeout=max(0.0, latest - time.monotonic()))
                if thread is not threading.current_thread():
                    thread.join(max(0.0, latest - time.monotonic()))

    def _callback(self, call: Callable[[Any], None]) -> zenoh.handlers.Callback[Any]:
        """Return a callback that Zenoh runs in its own thread; the thread's end is reported."""
        import zenoh

        self._callbacks += 1
        return zenoh.handlers.Callback(call, lambda: self._ended.put(threading.current_thread()))


def listening(
    port: int,
    hosts: Sequence[str] = ("127.0.0.1",),
    settings: Mapping[str, object] = _NONE,
    *,
    tls: bool = False,
) -> WrappedSession:
    """Open a session that others connect to; raises InputInvalid if the port is in use.

    Port 0 is any free one, which the attribute `port` then holds.
    """
    import zenoh

    pending = {"transport/unicast/accept_pending": _half_open()}
    left = _TRIES if port == 0 else 1
    while True:
        left, chosen = left - 1, port or free_port(hosts[0])
        endpoints = endpoints_of(hosts, chosen, tls=tls)
        try:
            config = _config("router", endpoints, {**_LISTENING, **pending, **settings})
            return WrappedSession(zenoh.open(config), chosen)
        except zenoh.ZError as error:
            if "in use" not in str(error):
                reason = str(error).split(" at /", 1)[0]  # without the place in Zenoh's source
                raise InputInvalid(f"cannot listen on {', '.join(endpoints)}: {reason}") from None
            if not left:  # else another program has taken the port meanwhile
                raise InputInvalid(
                    f"port {chosen} on {', '.join(hosts)} is in use",
                    f"a free one, such as port {chosen + 100}, or 0 for any",
                ) from None


def connecting(
    host: str, port: int, settings: Mapping[str, object] = _NONE, *, tls: bool = False
) -> WrappedSession:
    """Open a session to a server; raises Disconnected if none listens, or NoSession."""
    import zenoh

    try:
        config = _config("client", endpoints_of([host], port, tls=tls), settings)
        return WrappedSession(zenoh.open(config))
    except zenoh.ZError:
        try:
            socket.create_connection((host, port), timeout=1.0).close()
        except OSError:
            raise Disconnected(
                f"no server answers at {host}, port {port}; expected a co-simulation there, such "
                "as "
                f"by `uuvsim serve SYSTEM --port {port}`"
            ) from None
        raise NoSession(
            f"{host}, port {port}, accepts connections, but opens no Zenoh session; expected the "
            "port that `uuvsim serve` prints for Python, and a server that is not overloaded"
        ) from None


def free_port(host: str) -> int:
    """Find a port that no program listens on; raises InputInvalid for another machine's address."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as s:
        try:
            s.bind((host, 0))
        except OSError as error:
            raise InputInvalid(
                f"cannot listen at {host}", error.strerror, "an address of this machine"
            ) from None
        return int(s.getsockname()[1])


def _config(mode: str, endpoints: Sequence[str], settings: Mapping[str, object]) -> zenoh.Config:
    """Return the settings of a "router", which listens, or of a "client", which connects."""
    import zenoh

    # Zenoh closes silent connections one after another, in 4 ms each, in the threads that open
    # sessions. By default there is one thread, and a client would wait for all of them.
    os.environ.setdefault("ZENOH_RUNTIME", "(acc: (worker_threads: 8))")
    config = zenoh.Config()
    every: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": list(endpoints) if mode == "router" else [],
        "connect/endpoints": list(endpoints) if mode == "client" else [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "queries_default_timeout": 1000 * _FOREVER,
        "transport/link/rx/max_message_size": _LARGEST,
        # The threshold of `SharedMemory`; Zenoh's own, 3 kB, costs more than it saves.
        "transport/shared_memory/transport_optimization/message_size_threshold": LARGE,
        **settings,
    }
    for key, value in every.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _half_open() -> int:
    """Return how many connections may wait for their session to be opened."""
    try:
        import resource
    except ImportError:  # Windows
        return 4096
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return 4096 if files == resource.RLIM_INFINITY else min(4096, max(64, files // 2))
