"""The places of one transport: silent connections cannot take those of clients.

A connection is a stranger until it has shown that it may enter. Strangers have places of their own;
when all are taken, the newest comes in and the oldest must go. A client that was let in keeps its
place, and gives it up only where the transport calls it idle.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from dataclasses import dataclass
from typing import final

__all__ = ["Limits", "Places"]


@dataclass(frozen=True)
class Limits:
    """Limits of one client at a server, so that no client can slow or stop the others."""

    clients: int = 32
    strangers: int = 128  # connections that have not shown yet that they may enter
    hello_s: float = 5.0  # a client says who it is within this time, or is let go
    frame_s: float = 10.0  # a frame that has begun ends within this time, in both directions
    header_bytes: int = 1 << 20
    payload_bytes: int = 8 << 20
    unknown_bytes: int = 1 << 16  # of one that has not shown yet that it may enter
    answer_bytes: int = 512 << 20  # of numbers: a longer run is refused before it begins
    calls_per_s: float = 5000.0  # of calls that do not step; faster ones are made to wait
    connections_per_s: float = 200.0
    patience_s: float = 1.0  # where all places are taken, an idle HTTP client gives up its own


@final
class Places:
    """The connections of one transport, from any thread."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._strangers: dict[socket.socket, None] = {}  # the oldest first
        self._clients: set[socket.socket] = set()
        self._idle: dict[socket.socket, float] = {}  # clients that ask nothing now, since when

    def enter(self, connection: socket.socket) -> bool:
        """Take a stranger's place; False if clients have all places, so that none can follow."""
        with self._lock:
            if self._full():
                return False
            if len(self._strangers) >= self._limits.strangers:
                oldest = next(iter(self._strangers))
                del self._strangers[oldest]
                _end(oldest)
            self._strangers[connection] = None
            return True

    def let_in(self, connection: socket.socket) -> bool:
        """Move a connection to a client's place; return False if there is none, or it has ended."""
        with self._lock:
            if connection in self._clients:
                self._idle.pop(connection, None)
                return True
            if connection not in self._strangers or self._full():
                return False
            del self._strangers[connection]
            if len(self._clients) >= self._limits.clients:
                longest = next(iter(self._idle))
                self._clients.discard(longest)
                del self._idle[longest]
                _end(longest)
            self._clients.add(connection)
            return True

    def idle(self, connection: socket.socket) -> None:
        """Note that a client asks nothing now: others may have its place after a while."""
        with self._lock:
            if connection in self._clients:
                self._idle.pop(connection, None)
                self._idle[connection] = time.monotonic()

    def swap(self, plain: socket.socket, secured: socket.socket) -> bool:
        """Put a connection under TLS in its place; False if it was let go meanwhile."""
        with self._lock:
            here = plain in self._strangers
            self._strangers.pop(plain, None)
            if here:
                self._strangers[secured] = None
            return here

    def leave(self, connection: socket.socket) -> None:
        """Free the place of a connection that has ended."""
        with self._lock:
            self._strangers.pop(connection, None)
            self._clients.discard(connection)
            self._idle.pop(connection, None)

    def close(self) -> None:
        """End all connections."""
        with self._lock:
            every = [*self._strangers, *self._clients]
        for connection in every:
            _end(connection)

    def _full(self) -> bool:
        if len(self._clients) < self._limits.clients:
            return False
        since = next(iter(self._idle.values()), None)
        return since is None or time.monotonic() - since < self._limits.patience_s


def _end(connection: socket.socket) -> None:
    with contextlib.suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
