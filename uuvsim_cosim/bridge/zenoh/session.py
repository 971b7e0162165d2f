"""A Zenoh session that says in words what went wrong, and that lets Python end if left open."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, final

from uuvsim_cosim.bridge.access.zenoh import endpoints as endpoints_of
from uuvsim_cosim.bridge.calls.at_exit import close_at_exit
from uuvsim_cosim.bridge.zenoh.shared_memory import LARGE
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["PORT", "Disconnected", "NoSession", "WrappedSession", "connecting", "listening"]

PORT = 7470
_FOREVER = 10_000_000  # [s] that a query waits; a session that ends answers sooner
_PATIENCE = 5.0  # [s] that closing waits for threads that are inside Zenoh
_LARGEST = 64 << 20  # bytes of one message
_NONE: Mapping[str, Any] = {}
# A client that takes nothing off its line is let go. Half-open ones do not keep others out: each
# may wait for three seconds, and as many as leave half of the process's files to others.
_LISTENING = {
    "transport/unicast/max_sessions": 256,
    "transport/unicast/accept_timeout": 3000,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,
}


class Disconnected(UuvsimError):
    """The other end is not there, or is gone."""

    exit_status = 3


class NoSession(Disconnected):
    """Somebody listens there, but opens no session to this client."""


@final
class WrappedSession(Closing):
    """An open session; `close_at_exit` closes it when the program ends.

    After `close` no thread is inside Zenoh on its account. Python ends daemon threads where they
    ask for its lock; inside Zenoh that aborts the program ("exception not rethrown").
    """

    def __init__(self, session: Any) -> None:
        self._session = session
        self._left = threading.Condition()
        self._inside = 0  # threads that wait within a call of Zenoh
        self._callbacks = 0  # threads that Zenoh began, each of which ends with its callback
        self._ended: queue.SimpleQueue[threading.Thread] = queue.SimpleQueue()
        self._open = True
        close_at_exit(self)

    @property
    def raw(self) -> Any:
        """Return Zenoh's own session."""
        return self._session

    @property
    def is_open(self) -> bool:
        """Whether it has not been closed."""
        return self._open

    @property
    def is_connected(self) -> bool:
        """Whether there is anybody at the other end."""
        info = self._session.info
        return bool(info.routers_zid() or info.peers_zid())

    @contextlib.contextmanager
    def inside(self) -> Iterator[None]:
        """Count a call of Zenoh that waits; raises Disconnected if the session is closed."""
        with self._left:
            if not self._open:
                raise Disconnected("this connection is closed; expected an open one")
            self._inside += 1
        try:
            yield
        finally:
            with self._left:
                self._inside -= 1
                self._left.notify_all()

    def answer(self, key: str, answer: Callable[[Any], None]) -> Any:
        """Let a function answer the queries on a key, one after another in a thread."""
        return self._session.declare_queryable(key, self._callback(answer))

    def asker(self, key: str, timeout: float = _FOREVER) -> Any:
        """Return what asks queries of a key, and waits as long as the answer takes, or `timeout` s.

        The one answer is given as it comes: without consolidation, which waits for others.
        """
        import zenoh

        return self._session.declare_querier(
            key,
            timeout=timeout,
            consolidation=zenoh.ConsolidationMode.NONE,
            express=True,
        )

    def publisher(self, key: str, encoding: str = "zenoh/bytes") -> Any:
        """Return a publisher of state: messages that cannot be sent at once are dropped."""
        import zenoh

        return self._session.declare_publisher(
            key,
            encoding=encoding,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
        )

    def subscribe(self, key: str, keep: int) -> Any:
        """Subscribe to a key; the newest `keep` messages wait to be received."""
        import zenoh

        return self._session.declare_subscriber(key, zenoh.handlers.RingChannel(keep))

    def token(self, key: str) -> Any:
        """Say that something lives, until this session ends."""
        return self._session.liveliness().declare_token(key)

    def alive(self, key: str) -> list[str]:
        """List the keys of what lives now."""
        replies = self._session.liveliness().get(key, timeout=5.0)
        return [str(r.ok.key_expr) for r in replies if r.ok is not None]

    def watch(self, key: str, tell: Callable[[str, bool], None]) -> Any:
        """Tell of each key that begins (True) or ceases (False) to live."""
        import zenoh

        def told(sample: Any) -> None:
            tell(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        return self._session.liveliness().declare_subscriber(
            key, self._callback(told), history=True
        )

    def close(self) -> None:
        """Close the session; whoever waits for a message is let go."""
        with self._left:
            was, self._open = self._open, False
        if not was:
            return
        with contextlib.suppress(Exception):  # the other end may be gone already
            self._session.close()
        latest = time.monotonic() + _PATIENCE
        with self._left:
            self._left.wait_for(lambda: not self._inside, _PATIENCE)
        with contextlib.suppress(queue.Empty):
            for _ in range(self._callbacks):
                thread = self._ended.get(timeout=max(0.0, latest - time.monotonic()))
                if thread is not threading.current_thread():
                    thread.join(max(0.0, latest - time.monotonic()))

    def _callback(self, call: Callable[[Any], None]) -> Any:
        """Return what Zenoh calls in a thread of its own, which reports its end to `close`."""
        import zenoh

        self._callbacks += 1
        return zenoh.handlers.Callback(call, lambda: self._ended.put(threading.current_thread()))


def listening(
    port: int,
    hosts: Sequence[str] = ("127.0.0.1",),
    settings: Mapping[str, Any] = _NONE,
    *,
    tls: bool = False,
) -> WrappedSession:
    """Open a session that others connect to; raises InputInvalid if the port is taken."""
    import zenoh

    endpoints = endpoints_of(hosts, port, tls=tls)
    try:
        room = {"transport/unicast/accept_pending": _half_open()}
        config = _config("router", listen=endpoints, settings={**_LISTENING, **room, **settings})
        return WrappedSession(zenoh.open(config))
    except zenoh.ZError as error:
        if "in use" in str(error):
            raise InputInvalid(
                f"port {port} on {', '.join(hosts)} is in use; expected a free one, such as port "
                f"{port + 100}, or 0 for any"
            ) from None
        raise InputInvalid(f"cannot listen on {', '.join(endpoints)}: {_words(error)}") from None


def connecting(
    host: str, port: int, settings: Mapping[str, Any] = _NONE, *, tls: bool = False
) -> WrappedSession:
    """Open a session to one that listens; raises Disconnected if nobody does, or NoSession."""
    import zenoh

    try:
        config = _config("client", connect=endpoints_of([host], port, tls=tls), settings=settings)
        return WrappedSession(zenoh.open(config))
    except zenoh.ZError:
        if _listens(host, port):
            raise NoSession(
                f"{host}, port {port}, takes connections, but opens no Zenoh session; expected the "
                "port that `uuvsim serve` names for Python, and a server that is not overloaded"
            ) from None
        raise Disconnected(
            f"nobody answers at {host}, port {port}; expected a co-simulation there, such as by "
            f"`uuvsim serve SYSTEM --port {port}`"
        ) from None


def _config(
    mode: str,
    listen: Sequence[str] = (),
    connect: Sequence[str] = (),
    settings: Mapping[str, Any] = _NONE,
) -> Any:
    import zenoh

    # Zenoh closes connections that stay silent one after another, in 4 ms each, in the threads that
    # open sessions; by default there is one, and a client would wait for all of them.
    os.environ.setdefault("ZENOH_RUNTIME", "(acc: (worker_threads: 8))")
    config = zenoh.Config()
    held: dict[str, Any] = {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "queries_default_timeout": 1000 * _FOREVER,
        "transport/link/rx/max_message_size": _LARGEST,
        # As `SharedMemory` does; by itself Zenoh would, from 3 kB on, which costs more than bytes.
        "transport/shared_memory/transport_optimization/message_size_threshold": LARGE,
        **settings,
    }
    for key, value in held.items():
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


def _listens(host: str, port: int) -> bool:
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError:
        return False
    return True


def _words(error: Exception) -> str:
    return str(error).split(" at /", 1)[0]
