"""Limits of the connections of one transport: silent connections cannot displace clients.

Connections that are not authenticated have slots of their own. When all of these are in use, a new
connection displaces the oldest. An authenticated client keeps its slot, and gives it up only while
the transport reports it as idle.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from dataclasses import dataclass
from typing import final

__all__ = ["ConnectionSlots", "Limits"]


@dataclass(frozen=True)
class Limits:
    """Limits of one client at a server, so that no client can slow down or block the others."""

    clients: int = 32
    unauthenticated: int = 128  # connections that are not authenticated yet
    hello_s: float = 5.0  # time in which a client must authenticate, else it is disconnected
    frame_s: float = 10.0  # time in which a frame that has begun must end, in both directions
    header_bytes: int = 1 << 20
    payload_bytes: int = 8 << 20
    unknown_bytes: int = 1 << 16  # of a request of a client that is not authenticated yet
    answer_bytes: int = 512 << 20  # of numbers: a longer run is refused before it begins
    calls_per_s: float = 5000.0  # of calls that do not step; faster clients are delayed
    connections_per_s: float = 200.0
    patience_s: float = 1.0  # idle time after which an HTTP client can lose its slot to another


@final
class ConnectionSlots:
    """The connections of one transport; all methods may be called from any thread."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._lock = threading.Lock()
        self._unauthenticated: dict[socket.socket, None] = {}  # the oldest first
        self._clients: set[socket.socket] = set()
        self._idle: dict[socket.socket, float] = {}  # idle client -> since when, the oldest first

    def add(self, connection: socket.socket) -> bool:
        """Add an unauthenticated connection; return False if all clients' slots are in use."""
        with self._lock:
            if self._full():
                return False
            if len(self._unauthenticated) >= self._limits.unauthenticated:
                oldest = next(iter(self._unauthenticated))
                del self._unauthenticated[oldest]
                _end(oldest)
            self._unauthenticated[connection] = None
            return True

    def admit(self, connection: socket.socket) -> bool:
        """Move a connection to a client's slot; return False if none is free, or it has ended."""
        with self._lock:
            if connection in self._clients:
                self._idle.pop(connection, None)
                return True
            if connection not in self._unauthenticated or self._full():
                return False
            del self._unauthenticated[connection]
            if len(self._clients) >= self._limits.clients:
                longest = next(iter(self._idle))
                self._clients.discard(longest)
                del self._idle[longest]
                _end(longest)
            self._clients.add(connection)
            return True

    def idle(self, connection: socket.socket) -> None:
        """Note that a client has no request now: others may get its slot after `patience_s`."""
        with self._lock:
            if connection in self._clients:
                self._idle.pop(connection, None)
                self._idle[connection] = time.monotonic()

    def swap(self, plain: socket.socket, secured: socket.socket) -> bool:
        """Replace a connection by its TLS connection; return False if it was ended meanwhile."""
        with self._lock:
            here = plain in self._unauthenticated
            self._unauthenticated.pop(plain, None)
            if here:
                self._unauthenticated[secured] = None
            return here

    def free(self, connection: socket.socket) -> None:
        """Free the slot of a connection that has ended."""
        with self._lock:
            self._unauthenticated.pop(connection, None)
            self._clients.discard(connection)
            self._idle.pop(connection, None)

    def close(self) -> None:
        """End all connections."""
        with self._lock:
            every = [*self._unauthenticated, *self._clients]
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
