"""The TCP server, for MATLAB, Octave and other programs that exchange frames of float64."""

from __future__ import annotations

import contextlib
import errno
import socket
import ssl
import threading
import time
from collections.abc import Sequence

from uuvsim_cosim.bridge.access.access_file import LOOPBACK
from uuvsim_cosim.bridge.access.authentication import Admission
from uuvsim_cosim.bridge.access.tls import secured
from uuvsim_cosim.bridge.access.token import TokenFile, guarded_by_token
from uuvsim_cosim.bridge.calls.connection_limits import ConnectionSlots, Limits
from uuvsim_cosim.bridge.calls.service import Service
from uuvsim_cosim.bridge.tcp.framing import TCP_PORT, Disconnected, frame
from uuvsim_cosim.bridge.tcp.requests import failure
from uuvsim_cosim.bridge.tcp.session import Session, full
from uuvsim_cosim.closing import Owner, started
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["LOOPBACK", "TcpServer", "listening"]


class TcpServer(Owner):
    """The TCP server: it listens from construction to `close`; each client has its own thread.

    Without `admit`, clients need the token of this user.
    """

    def __init__(
        self,
        service: Service,
        port: int = TCP_PORT,
        hosts: Sequence[str] = LOOPBACK,
        *,
        admit: Admission | None = None,
        limits: Limits | None = None,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        self._service = service
        self._admit = admit or guarded_by_token()
        self._limits = limits or Limits()
        self._tls = tls
        self._slots = ConnectionSlots(self._limits)
        self._serving: set[threading.Thread] = set()
        self._closed = False
        with self._opening() as opened:
            self._listeners = listening(hosts, port, "TCP")
            opened.callback(self._end)
            self.port: int = self._listeners[0].getsockname()[1]
            opened.enter_context(TokenFile(self._admit, self.port))
            for one in self._listeners:
                self._serving.add(started("uuvsim-tcp", self._accept, one))

    @property
    def addresses(self) -> tuple[str, ...]:
        """Where it listens, as `host:port`."""
        return tuple(
            f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
            for host, port, *_ in (one.getsockname() for one in self._listeners)
        )

    def _end(self) -> None:
        """Disconnect all clients and stop listening."""
        self._closed = True
        self._slots.close()
        for one in self._listeners:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()
        for thread in list(self._serving):
            thread.join(timeout=2.0)

    def _accept(self, listener: socket.socket) -> None:
        pause = 1.0 / self._limits.connections_per_s
        while not self._closed:
            try:
                client, _ = listener.accept()
            except OSError:
                if self._closed:
                    return
                time.sleep(0.05)  # too many open files, for example: other clients continue
                continue
            client.settimeout(self._limits.hello_s)
            if self._slots.add(client):
                started("uuvsim-tcp-client", self._serve, client)
            else:
                client.setblocking(False)
                with client, contextlib.suppress(OSError):
                    client.send(frame(failure(full(self._limits))))
            time.sleep(pause)

    def _serve(self, plain: socket.socket) -> None:
        """Serve one connection in its thread, and report the error that ends it to the client."""
        client = plain
        self._serving.add(threading.current_thread())
        try:
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # The system detects within a minute that a client's machine is gone.
            client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            for option, value in (("TCP_KEEPIDLE", 20), ("TCP_KEEPINTVL", 10), ("TCP_KEEPCNT", 4)):
                if hasattr(socket, option):
                    client.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
            if self._tls is not None:
                client = secured(plain, self._tls, self._limits.hello_s)
                if not self._slots.swap(plain, client):
                    return  # a newer connection has displaced it
            Session(self._service, self._admit, self._limits, self._slots, client).serve()
        except (Disconnected, OSError):
            pass  # the client has disconnected
        except UuvsimError as error:
            with contextlib.suppress(OSError):
                client.settimeout(1.0)
                client.sendall(frame(failure(error)))
                client.shutdown(socket.SHUT_WR)
        finally:
            for one in (plain, client):
                self._slots.free(one)
            client.close()
            self._serving.discard(threading.current_thread())


def listening(hosts: Sequence[str], port: int, what: str) -> list[socket.socket]:
    """Open listening sockets, all on one port (0: a free one); raises InputInvalid."""
    found: list[socket.socket] = []
    for host in hosts:
        try:
            found.append(_listener(host, port))
        except OSError as error:
            absent = error.errno in (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT)
            if host == "::1" and absent and found:
                continue  # a machine without IPv6
            for one in found:
                one.close()
            reason = "it is in use" if error.errno == errno.EADDRINUSE else error.strerror
            raise InputInvalid(
                f"{what} port {port} at {host} cannot be opened: {reason}; another "
                "co-simulation may be served there: end it, or choose another port (0: any free)"
            ) from None
        port = port or found[0].getsockname()[1]
    return found


def _listener(host: str, port: int) -> socket.socket:
    """Open one listening socket; an IPv6 one does not also accept IPv4 connections."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        if family == socket.AF_INET6:
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(1024)
    except OSError:
        listener.close()
        raise
    return listener
