"""Limits of the connections of one transport: silent connections cannot displace clients.

A connection is a stranger until it is authenticated. Strangers have places of their own; when all
of these are occupied, a new stranger displaces the oldest. An authenticated client keeps its place,
and gives it up only while the transport calls it idle.
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
    """Limits of one client at a server, so that no client can slow down or block the others."""

    clients: int = 32
    strangers: int = 128  # connections that are not authenticated yet
    hello_s: float = 5.0  # time in which a client must authenticate, else it is disconnected
    frame_s: float = 10.0  # time in which a frame that has begun must end, in both directions
    header_bytes: int = 1 << 20
    payload_bytes: int = 8 << 20
    unknown_bytes: int = 1 << 16  # of a request of a client that is not authenticated yet
    answer_bytes: int = 512 << 20  # of numbers: a longer run is refused before it begins
    calls_per_s: float = 5000.0  # of calls that do not step; faster clients are delayed
    connections_per_s: float = 200.0
    patience_s: float = 1.0  # idle time after which an HTTP client can lose its place to another


@final
class Places:
    """The connections of one transport; all methods may be called from any thread."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._strangers: dict[socket.socket, None] = {}  # the oldest first
        self._clients: set[socket.socket] = set()
        self._idle: dict[socket.socket, float] = {}  # idle client -> since when, the oldest first

    def enter(self, connection: socket.socket) -> bool:
        """Give a connection a stranger's place; return False if all clients' places are in use."""
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
        """Move a connection to a client's place; return False if none is free, or it has ended."""
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
        """Note that a client has no request now: others may get its place after `patience_s`."""
        with self._lock:
            if connection in self._clients:
                self._idle.pop(connection, None)
                self._idle[connection] = time.monotonic()

    def swap(self, plain: socket.socket, secured: socket.socket) -> bool:
        """Replace a connection by its TLS connection; return False if it was ended meanwhile."""
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
