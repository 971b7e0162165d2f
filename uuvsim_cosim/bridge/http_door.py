"""The HTTP door: JSON for webread, curl and browsers, and a page with live values."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
import time
from collections.abc import Sequence
from http.server import ThreadingHTTPServer
from typing import Any

from uuvsim_cosim.bridge.desk import Desk
from uuvsim_cosim.bridge.http_answers import Door, Handler
from uuvsim_cosim.bridge.tcp_door import LOOPBACK, listening
from uuvsim_cosim.bridge.tcp_session import Admission, everybody
from uuvsim_cosim.bridge.wire import HTTP_PORT, Limits

__all__ = ["HttpDoor"]

_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\n"
    b"Content-Length: %d\r\nConnection: close\r\n\r\n%s"
)


class HttpDoor:
    """Listens from construction to `close`; each connection has a thread, and its limits."""

    def __init__(
        self,
        desk: Desk,
        port: int = HTTP_PORT,
        hosts: Sequence[str] = LOOPBACK,
        *,
        admit: Admission = everybody,
        limits: Limits | None = None,
    ) -> None:
        door = Door(desk, admit, limits or Limits(), local=set(hosts) <= set(LOOPBACK))
        self._door = door
        self._servers = [_Server(one, door) for one in listening(hosts, port, "HTTP")]
        self.port: int = self._servers[0].server_address[1]
        self._threads = [
            threading.Thread(
                target=server.serve_forever, args=(0.05,), name="uuvsim-http", daemon=True
            )
            for server in self._servers
        ]
        for thread in self._threads:
            thread.start()

    @property
    def addresses(self) -> tuple[str, ...]:
        """Where a browser finds it."""
        hosts = [str(server.socket.getsockname()[0]) for server in self._servers]
        shown = (f"[{host}]" if ":" in host else host for host in hosts)
        return tuple(f"http://{host}:{self.port}/" for host in shown)

    def close(self) -> None:
        """Let all clients go and stop listening."""
        self._door.closed.set()
        for server in self._servers:
            server.shutdown()
            server.server_close()
        for one in list(self._door.open):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(timeout=2.0)

    def __enter__(self) -> HttpDoor:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Server(ThreadingHTTPServer):
    """The standard library's, on a socket that listens already, with a limit of connections."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, listener: socket.socket, door: Door) -> None:
        self.address_family = listener.family
        self._accepted = 0.0
        self.door = door
        super().__init__(listener.getsockname(), _Connection, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self.server_address = listener.getsockname()[:2]

    def process_request(self, request: Any, client_address: Any) -> None:
        """Take a connection, or say that there are too many."""
        door = self.door
        pause = self._accepted + 1 / door.limits.connections_per_s - time.monotonic()
        if pause > 0:
            time.sleep(pause)
        self._accepted = time.monotonic()
        with door.lock:
            full = len(door.open) >= door.limits.clients
            if not full:
                door.open.add(request)
        if full:
            words = b'{"error": "%d connections are open, which is all that may be; close one"}'
            text = words % door.limits.clients
            request.setblocking(False)
            with contextlib.suppress(OSError):
                request.send(_FULL % (len(text), text))
            self.shutdown_request(request)
        else:
            super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Forget a connection that has ended."""
        with self.door.lock:
            self.door.open.discard(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a client that breaks off is no error of this side."""


class _Connection(Handler):
    """One connection; a request that has begun must be whole within its time."""

    def setup(self) -> None:
        assert isinstance(self.server, _Server)
        self.door = self.server.door
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().setup()
        self._raw = _Timed(self.connection, self.door.limits)
        self.rfile = io.BufferedReader(self._raw)

    def handle_one_request(self) -> None:
        """Answer a request, with a fresh allowance of time for the next."""
        self._raw.end = None
        super().handle_one_request()


class _Timed(io.RawIOBase):
    """Bytes of a socket, all of one request within the time that a frame has."""

    IDLE_S = 60.0

    def __init__(self, connection: socket.socket, limits: Limits) -> None:
        self._connection = connection
        self._limits = limits
        self.end: float | None = None

    def readable(self) -> bool:
        """Tell that it can be read."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read what has come; raises TimeoutError when the request takes too long."""
        now = time.monotonic()
        wait = self.IDLE_S if self.end is None else self.end - now
        self._connection.settimeout(max(wait, 0.001))
        count = self._connection.recv_into(buffer)
        if self.end is None:
            self.end = time.monotonic() + self._limits.frame_s
        self._connection.settimeout(self._limits.frame_s)  # for what is written
        return count
