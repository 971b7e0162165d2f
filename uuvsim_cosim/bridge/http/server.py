"""The HTTP server: JSON for webread, curl and browsers, and pages with live values."""

from __future__ import annotations

import contextlib
import io
import json
import socket
import ssl
import time
from collections.abc import Sequence
from http import HTTPStatus
from http.server import ThreadingHTTPServer
from typing import TYPE_CHECKING

from uuvsim_cosim.bridge.access.access_file import is_loopback
from uuvsim_cosim.bridge.access.authentication import Admission
from uuvsim_cosim.bridge.access.tls import secured
from uuvsim_cosim.bridge.access.token import TokenFile, guarded_by_token
from uuvsim_cosim.bridge.calls.connection_limits import Limits
from uuvsim_cosim.bridge.calls.service import Service
from uuvsim_cosim.bridge.http.request_handler import Endpoint, Handler
from uuvsim_cosim.bridge.tcp.framing import HTTP_PORT
from uuvsim_cosim.bridge.tcp.server import LOOPBACK, listening
from uuvsim_cosim.closing import Owner, started
from uuvsim_cosim.errors import UuvsimError

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

__all__ = ["HttpServer"]

_Request = socket.socket | tuple[bytes, socket.socket]  # as the base class has it, also for UDP


class HttpServer(Owner):
    """The HTTP server: it listens from construction to `close`; each connection has a thread.

    Without `admit`, clients need the token of this user.
    """

    def __init__(
        self,
        service: Service,
        port: int = HTTP_PORT,
        hosts: Sequence[str] = LOOPBACK,
        *,
        admit: Admission | None = None,
        limits: Limits | None = None,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        local = all(is_loopback(host) for host in hosts)
        admit = admit or guarded_by_token()
        endpoint = Endpoint(service, admit, limits or Limits(), local=local)
        self._tls = tls
        self._endpoint = endpoint
        with self._opening() as opened:
            self._servers = [_Server(one, endpoint, tls) for one in listening(hosts, port, "HTTP")]
            for server in self._servers:
                opened.callback(server.server_close)
            self.port: int = self._servers[0].server_address[1]
            opened.enter_context(TokenFile(admit, self.port))
            self._threads = [
                started("uuvsim-http", server.serve_forever, 0.05) for server in self._servers
            ]
            opened.callback(self._end)

    @property
    def addresses(self) -> tuple[str, ...]:
        """The addresses for a browser."""
        hosts = [str(server.socket.getsockname()[0]) for server in self._servers]
        shown = (f"[{host}]" if ":" in host else host for host in hosts)
        kind = "http" if self._tls is None else "https"
        return tuple(f"{kind}://{host}:{self.port}/" for host in shown)

    def _end(self) -> None:
        """Disconnect all clients and stop listening."""
        self._endpoint.closed.set()
        with contextlib.suppress(UuvsimError):  # the service may have ended before
            self._endpoint.sessions.close()
        for server in self._servers:
            server.shutdown()
        self._endpoint.slots.close()
        for thread in self._threads:
            thread.join(timeout=2.0)


class _Server(ThreadingHTTPServer):
    """A server on a socket that listens already, with a limit of connections."""

    daemon_threads = True
    block_on_close = False

    def __init__(
        self, listener: socket.socket, endpoint: Endpoint, tls: ssl.SSLContext | None = None
    ) -> None:
        self.address_family = listener.family
        self._accepted = 0.0
        self.endpoint = endpoint
        self.tls = tls
        super().__init__(listener.getsockname(), _Connection, bind_and_activate=False)
        self.socket.close()
        self.socket = listener
        self.server_address = listener.getsockname()[:2]

    def process_request(self, request: _Request, client_address: object) -> None:
        """Accept a connection, or answer that there are too many."""
        assert isinstance(request, socket.socket)
        endpoint = self.endpoint
        pause = self._accepted + 1 / endpoint.limits.connections_per_s - time.monotonic()
        if pause > 0:
            time.sleep(pause)
        self._accepted = time.monotonic()
        if endpoint.slots.add(request):
            super().process_request(request, client_address)
            return
        request.setblocking(False)
        with contextlib.suppress(OSError):
            request.send(_last_answer(HTTPStatus.SERVICE_UNAVAILABLE, endpoint.full))
        self.shutdown_request(request)

    def shutdown_request(self, request: _Request) -> None:
        """Free the place of a connection that has ended."""
        assert isinstance(request, socket.socket)
        self.endpoint.slots.free(request)
        super().shutdown_request(request)

    def handle_error(self, request: _Request, client_address: object) -> None:
        """Print nothing: a client that disconnects is no error of the server."""


def _last_answer(status: HTTPStatus, message: str) -> bytes:
    """Return an answer to a connection that no handler serves, and that is closed after it."""
    text = json.dumps({"ok": False, "error": message})
    head = f"HTTP/1.1 {status.value} {status.phrase}\r\nContent-Type: application/json\r\n"
    return f"{head}Content-Length: {len(text)}\r\nConnection: close\r\n\r\n{text}".encode()


class _Connection(Handler):
    """One connection; a request that has begun must be complete within a time limit."""

    def setup(self) -> None:
        assert isinstance(self.server, _Server)
        self.endpoint = self.server.endpoint
        self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if (context := self.server.tls) is not None:
            plain = self.request
            try:
                self.request = secured(plain, context, self.endpoint.limits.hello_s)
            except UuvsimError as error:
                plain.sendall(_last_answer(HTTPStatus.BAD_REQUEST, f"{error}: https://"))
                raise
            if not self.endpoint.slots.swap(plain, self.request):
                self._forget(self.request)
                raise ConnectionAbortedError
        super().setup()
        self._raw = _Timed(self.connection, self.endpoint.limits)
        self.rfile = io.BufferedReader(self._raw)

    def handle_one_request(self) -> None:
        """Answer a request; its time limit begins with its first byte."""
        self._raw.end = None
        self.endpoint.slots.idle(self.connection)
        super().handle_one_request()

    def finish(self) -> None:
        """Close the connection; the base class knows only the socket below TLS."""
        super().finish()
        if isinstance(self.request, ssl.SSLSocket):
            self._forget(self.request)

    def _forget(self, client: socket.socket) -> None:
        self.endpoint.slots.free(client)
        client.close()


class _Timed(io.RawIOBase):
    """Bytes of a socket; all bytes of one request must arrive within `frame_s`."""

    IDLE_S = 60.0

    def __init__(self, connection: socket.socket, limits: Limits) -> None:
        self._connection = connection
        self._limits = limits
        self.end: float | None = None

    def readable(self) -> bool:
        """Return that it can be read."""
        return True

    def readinto(self, buffer: WriteableBuffer) -> int:
        """Read what has arrived; raises TimeoutError if the request takes too long."""
        now = time.monotonic()
        wait = self.IDLE_S if self.end is None else self.end - now
        self._connection.settimeout(max(wait, 0.001))
        count = self._connection.recv_into(buffer)
        if self.end is None:
            self.end = time.monotonic() + self._limits.frame_s
        self._connection.settimeout(self._limits.frame_s)  # for writing the answer
        return count
