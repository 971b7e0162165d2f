"""A Zenoh session that says in words what went wrong, and that lets Python end if left open."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

from uuvsim_cosim.bridge.access_zenoh import endpoints as endpoints_of
from uuvsim_cosim.bridge.at_exit import close_at_exit
from uuvsim_cosim.bridge.shared_memory import LARGE
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["PORT", "Disconnected", "WrappedSession", "connecting", "listening"]

PORT = 7470
_FOREVER = 10_000_000  # [s] that a query waits; a session that ends answers sooner
_LARGEST = 64 << 20  # bytes of one message
_NONE: Mapping[str, Any] = {}
# A client that takes nothing off its line is let go; half-open ones do not keep others out.
_LISTENING = {
    "transport/unicast/max_sessions": 128,
    "transport/unicast/accept_pending": 64,
    "transport/unicast/accept_timeout": 3000,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,
}


class Disconnected(UuvsimError):
    """The other end is not there, or is gone."""

    exit_status = 3


@final
class WrappedSession(Closing):
    """An open session; `close_at_exit` closes it when the program ends."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self._lock = threading.Lock()
        self._open = True
        close_at_exit(self)

    @property
    def raw(self) -> Any:
        """Give Zenoh's own session."""
        return self._session

    @property
    def is_open(self) -> bool:
        """Say whether it has not been closed."""
        return self._open

    @property
    def is_connected(self) -> bool:
        """Say whether there is anybody at the other end."""
        info = self._session.info
        return bool(info.routers_zid() or info.peers_zid())

    def answer(self, key: str, answer: Callable[[Any], None]) -> Any:
        """Let a function answer the queries on a key, one after another in a thread."""
        return self._session.declare_queryable(key, answer)

    def asker(self, key: str, timeout: float = _FOREVER) -> Any:
        """Give what asks queries of a key, and waits as long as the answer takes, or `timeout` s.

        The one answer is given as it comes: without consolidation, which waits for others.
        """
        import zenoh

        return self._session.declare_querier(
            key,
            timeout=timeout,
            consolidation=zenoh.ConsolidationMode.NONE,
            express=True,
        )

    def publisher(self, key: str) -> Any:
        """Give a publisher of state: messages that cannot be sent at once are dropped."""
        import zenoh

        return self._session.declare_publisher(
            key,
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

        return self._session.liveliness().declare_subscriber(key, told, history=True)

    def close(self) -> None:
        """Close the session; whoever waits for a message is let go."""
        with self._lock:
            was, self._open = self._open, False
        if was:
            with contextlib.suppress(Exception):  # the other end may be gone already
                self._session.close()


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
        config = _config("router", listen=endpoints, settings={**_LISTENING, **settings})
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
    """Open a session to one that listens; raises Disconnected if nobody does."""
    import zenoh

    try:
        config = _config("client", connect=endpoints_of([host], port, tls=tls), settings=settings)
        return WrappedSession(zenoh.open(config))
    except zenoh.ZError:
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


def _words(error: Exception) -> str:
    return str(error).split(" at /", 1)[0]
