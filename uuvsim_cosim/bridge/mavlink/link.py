"""Addresses of MAVLink as pymavlink writes them, and the sockets behind them."""

from __future__ import annotations

import contextlib
import selectors
import socket
from dataclasses import dataclass, replace
from typing import Any, final

from uuvsim_cosim.bridge.access.access_file import is_loopback
from uuvsim_cosim.closing import Owner
from uuvsim_cosim.errors import InputInvalid

__all__ = ["DEFAULT", "Address", "Link", "dialect"]

DEFAULT = "udpout:127.0.0.1:14550"
_FORMS = ("udpout", "udpin", "tcp", "tcpin")
_PEERS = 8  # that one link serves at most
_DATAGRAMS = 64  # that are read at most before the vehicle's messages are sent again


def dialect() -> Any:
    """Return pymavlink's dialect of ArduPilot, MAVLink 2; raises InputInvalid without pymavlink."""
    try:
        from pymavlink.dialects.v20 import ardupilotmega
    except ImportError:
        raise InputInvalid(
            "MAVLink", "pymavlink is not installed", "`pip install 'uuvsim-cosim[mavlink]'`"
        ) from None
    return ardupilotmega


@dataclass(frozen=True)
class Address:
    """An address: `form` (udpout, udpin, tcp or tcpin), host and port.

    Example:

    >>> from uuvsim_cosim.bridge.mavlink.link import Address
    >>> print(Address.of("udpout:127.0.0.1:14550").instance(2))
    udpout:127.0.0.1:14570
    """

    form: str
    host: str
    port: int

    @staticmethod
    def of(text: str, *, anyone: bool = False) -> Address:
        """Read FORM:HOST:PORT; raises InputInvalid, also for another machine without `anyone`."""
        form, _, rest = text.partition(":")
        host, _, port = rest.rpartition(":")
        good = form in _FORMS and host and port.isascii() and port.isdigit()
        if not good or int(port) >= 1 << 16:
            raise InputInvalid(
                "MAVLink address", repr(text), f"FORM:HOST:PORT with one of {', '.join(_FORMS)}"
            )
        if not anyone and not is_loopback(host):
            raise InputInvalid(
                "MAVLink address",
                f"{text}, where other machines may command the vehicle without authentication",
                "an address of this machine, such as 127.0.0.1, or --anyone as well",
            )
        return Address(form, host, int(port))

    def instance(self, number: int) -> Address:
        """Return the address of a vehicle, counted from 0: each has a port 10 higher."""
        return replace(self, port=self.port + 10 * number)

    def __str__(self) -> str:
        """Return the text that pymavlink reads."""
        return f"{self.form}:{self.host}:{self.port}"


@final
class Link(Owner):
    """Sockets of one address; peers are found as they connect or send. One thread may use it.

    Peers are addresses for UDP and sockets for TCP. Raises InputInvalid if it cannot be opened.
    """

    def __init__(self, address: Address) -> None:
        self.address = address
        self.peers: list[Any] = []
        self._selector = selectors.DefaultSelector()
        udp = address.form.startswith("udp")
        family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
        with self._opening() as opened:
            opened.callback(self._selector.close)
            self._socket = socket.socket(family, socket.SOCK_DGRAM if udp else socket.SOCK_STREAM)
            opened.callback(self._socket.close)
            opened.callback(self._drop_all)
            place = (address.host, address.port)
            try:
                if address.form == "udpin":
                    self._socket.bind(place)
                elif address.form == "udpout":
                    self.peers.append((socket.gethostbyname(address.host), address.port))
                elif address.form == "tcpin":
                    self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    self._socket.bind(place)
                    self._socket.listen(_PEERS)
                else:
                    self._socket.settimeout(5.0)
                    self._socket.connect(place)
                    self.peers.append(self._socket)
            except OSError as error:
                raise InputInvalid(
                    f"MAVLink address {address}",
                    f"cannot be opened: {error.strerror or error}",
                    "a free port" if address.form.endswith("in") else "an address that answers",
                ) from None
            self._socket.setblocking(False)
            self._selector.register(self._socket, selectors.EVENT_READ)

    @property
    def port(self) -> int:
        """The port of this machine's end; for `udpout` 0 until the first message is sent."""
        return int(self._socket.getsockname()[1])

    def receive(self, timeout: float) -> list[tuple[Any, bytes]]:
        """Return the bytes that have arrived within `timeout` [s], each with its peer."""
        found: list[tuple[Any, bytes]] = []
        for key, _ in self._selector.select(timeout):
            one: Any = key.fileobj
            if self.address.form.startswith("udp"):
                self._datagrams(found)
            elif one is self._socket and self.address.form == "tcpin":
                with contextlib.suppress(OSError):
                    client, _ = one.accept()
                    if len(self.peers) >= _PEERS:
                        client.close()
                        continue
                    client.setblocking(False)
                    self._selector.register(client, selectors.EVENT_READ)
                    self.peers.append(client)
            else:
                try:
                    data = one.recv(1 << 14)
                except BlockingIOError:
                    continue
                except OSError:
                    data = b""
                if data:
                    found.append((one, data))
                else:
                    self._drop(one)
        return found

    def send(self, data: bytes, peer: Any = None) -> None:
        """Send to one peer, or to all; a TCP peer that does not read is disconnected."""
        for one in list(self.peers) if peer is None else [peer]:
            try:
                if self.address.form.startswith("udp"):
                    self._socket.sendto(data, one)
                elif one in self.peers and one.send(data) < len(data):
                    self._drop(one)
            except OSError:  # UDP: nobody listens there yet
                if not self.address.form.startswith("udp"):
                    self._drop(one)

    def has_room(self, peer: Any) -> bool:
        """Return whether a message to a peer can be sent now; without it, a TCP peer reads late."""
        if self.address.form.startswith("udp") or peer not in self.peers:
            return True
        with selectors.DefaultSelector() as asked:  # select() takes no file beyond the 1024th
            asked.register(peer, selectors.EVENT_WRITE)
            return bool(asked.select(0.0))

    def _datagrams(self, found: list[tuple[Any, bytes]]) -> None:
        for _ in range(_DATAGRAMS):
            try:
                data, peer = self._socket.recvfrom(1 << 16)
            except BlockingIOError:
                return
            except OSError:  # an earlier datagram was refused by its receiver
                continue
            if self.address.form == "udpin" and peer not in self.peers:
                self.peers = [*self.peers[1 - _PEERS :], peer]
            if peer in self.peers:
                found.append((peer, data))

    def _drop(self, one: socket.socket) -> None:
        if one in self.peers:
            self.peers.remove(one)
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(one)
        one.close()

    def _drop_all(self) -> None:
        if not self.address.form.startswith("udp"):
            for one in list(self.peers):
                self._drop(one)
