"""The HTTP door: JSON for webread, curl and browsers, and a page with live values."""

from __future__ import annotations

import contextlib
import io
import json
import socket
import ssl
import threading
import time
from collections.abc import Sequence
from http.server import ThreadingHTTPServer
from typing import Any

from uuvsim_cosim.bridge.access import is_loopback
from uuvsim_cosim.bridge.access_tls import secured
from uuvsim_cosim.bridge.desk import Desk
from uuvsim_cosim.bridge.http_answers import Door, Handler
from uuvsim_cosim.bridge.tcp_door import LOOPBACK, listening
from uuvsim_cosim.bridge.tcp_session import Admission, everybody
from uuvsim_cosim.bridge.wire import HTTP_PORT, Limits
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import UuvsimError

__all__ = ["HttpDoor"]

_PLAIN = (
    b"HTTP/1.1 400 Bad Request\r\nContent-Type: application/json\r\n"
    b"Content-Length: %d\r\nConnection: close\r\n\r\n%s"
)
_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\nContent-Type: application/json\r\n"
    b"Content-Length: %d\r\nConnection: close\r\n\r\n%s"
)


class HttpDoor(Closing):
    """Listens from construction to `close`; each connection has a thread, and its limits."""

    def __init__(
        self,
        desk: Desk,
        port: int = HTTP_PORT,
        hosts: Sequence[str] = LOOPBACK,
        *,
        admit: Admission = everybody,
        limits: Limits | None = None,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        local = all(is_loopback(host) for host in hosts)
        door = Door(desk, admit, limits or Limits(), local=local)
        self._tls = tls
        self._door = door
        self._servers = [_Server(one, door, tls) for one in listening(hosts, port, "HTTP")]
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
        kind = "http" if self._tls is None else "https"
        return tuple(f"{kind}://{host}:{self.port}/" for host in shown)

    def close(self) -> None:
        """Let all clients go and stop listening."""
        self._door.closed.set()
        with contextlib.suppress(UuvsimError):  # the desk may have ended before
            self._door.sessions.close()
        for server in self._servers:
            server.shutdown()
            server.server_close()
        for one in list(self._door.open):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join(timeout=2.0)


class _Server(ThreadingHTTPServer):
    """The standard library's, on a socket that listens already, with a limit of connections."""

    daemon_threads = True
    block_on_close = False

    def __init__(
        self, listener: socket.socket, door: Door, tls: ssl.SSLContext | None = None
    ) -> None:
        self.address_family = listener.family
        self._accepted = 0.0
        self.door = door
        self.tls = tls
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
            full = len(door.open) >= door.limits.clients and not self._made_room()
            if not full:
                door.open.add(request)
                door.silent[request] = time.monotonic()
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
            self.door.silent.pop(request, None)
        super().shutdown_request(request)

    def _made_room(self) -> bool:
        """Let a connection go that has asked nothing for a while, so that others may."""
        door = self.door
        for one, since in door.silent.items():  # the oldest first
            if time.monotonic() - since < door.limits.patience_s:
                return False
            del door.silent[one]
            door.open.discard(one)
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            return True
        return False

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: a client that breaks off is no error of this side."""


class _Connection(Handler):
    """One connection; a request that has begun must be whole within its time."""

    def setup(self) -> None:
        assert isinstance(self.server, _Server)
        self.door = self.server.door
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self.server.tls is not None:
            self._secure(self.request, self.server.tls)
        super().setup()
        self._raw = _Timed(self.connection, self.door.limits)
        self.rfile = io.BufferedReader(self._raw)

    def handle_one_request(self) -> None:
        """Answer a request, with a fresh allowance of time for the next."""
        self._raw.end = None
        with self.door.lock:
            if self.connection in self.door.open:
                self.door.silent[self.connection] = time.monotonic()
        super().handle_one_request()

    def finish(self) -> None:
        """End what TLS has begun."""
        super().finish()
        if isinstance(self.request, ssl.SSLSocket):
            self._forget(self.request)

    def _secure(self, plain: socket.socket, context: ssl.SSLContext) -> None:
        try:
            self.request = secured(plain, context, self.door.limits.hello_s)
        except UuvsimError as error:
            text = json.dumps({"ok": False, "error": f"{error}: https://"}).encode()
            plain.sendall(_PLAIN % (len(text), text))
            raise
        with self.door.lock:  # the plain one has no line any more
            let_go = plain not in self.door.open
            self.door.open.discard(plain)
            self.door.silent.pop(plain, None)
            self.door.open.add(self.request)
        if let_go:
            self._forget(self.request)
            raise ConnectionAbortedError

    def _forget(self, client: socket.socket) -> None:
        with self.door.lock:
            self.door.open.discard(client)
            self.door.silent.pop(client, None)
        client.close()


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
