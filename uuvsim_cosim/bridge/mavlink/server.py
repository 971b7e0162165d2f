"""The MAVLink end of a server: one thread for each vehicle of the system."""

from __future__ import annotations

import threading
import time
from typing import Any, final

from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.mavlink.link import DEFAULT, Address, Link, dialect
from uuvsim_cosim.bridge.mavlink.services import Services
from uuvsim_cosim.bridge.mavlink.vehicle import vehicles_of
from uuvsim_cosim.closing import Owner, started
from uuvsim_cosim.errors import InputInvalid

__all__ = ["MavlinkServer"]

_TURN = 0.05  # [s] between two turns of a vehicle
_MESSAGES = 256  # from one peer that are answered in a turn; further ones are dropped


class MavlinkServer(Owner):
    """The vehicles of a co-simulation over MAVLink, from construction to `close`.

    Vehicle k (from 0) has system id 1 + k and a port that is 10 k higher. Raises InputInvalid
    without pymavlink, without a hull, and for an address that cannot be opened.
    """

    def __init__(self, service: Service, address: str = DEFAULT, *, anyone: bool = False) -> None:
        mav = dialect()
        first = Address.of(address, anyone=anyone)
        self._closed = threading.Event()
        self.ends: list[_End] = []
        threads: list[threading.Thread] = []
        with self._opening() as opened:
            for number, vehicle in enumerate(vehicles_of(service)):
                link = opened.enter_context(Link(first.instance(number)))
                self.ends.append(_End(service, vehicle, number + 1, mav, link))

            def join() -> None:
                for one in threads:
                    one.join(timeout=2.0)

            opened.callback(join)
            opened.callback(self._closed.set)
            threads += [started("uuvsim-mavlink", end.serve, self._closed) for end in self.ends]

    @property
    def addresses(self) -> tuple[str, ...]:
        """The addresses of its vehicles."""
        return tuple(str(end.link.address) for end in self.ends)


@final
class _End:
    """One vehicle at one link."""

    def __init__(
        self, service: Service, vehicle: Any, system_id: int, mav: Any, link: Link
    ) -> None:
        self.link, self._mav = link, mav
        self._parsers: dict[Any, Any] = {}
        self._packer = mav.MAVLink(None, srcSystem=system_id, srcComponent=1)
        client = Client(f"mavlink-{system_id}", "mavlink", frozenset({"read", "set"}))
        self.services = Services(service, client, vehicle, system_id, mav, self._send)

    def serve(self, closed: threading.Event) -> None:
        """Answer messages and send the state until `closed` is set or the co-simulation ends."""
        next_turn = 0.0
        while not closed.is_set():
            now = time.monotonic()
            wait = 0.001 if self.services.is_busy else max(0.0, next_turn - now)
            try:
                for peer, data in self.link.receive(wait):
                    for message in self._parsed(peer, data)[:_MESSAGES]:
                        self.services.handle(message, peer)
                if self.services.is_busy or time.monotonic() >= next_turn:
                    next_turn = time.monotonic() + _TURN
                    self.services.turn()
            except InputInvalid:  # the co-simulation has ended, or a component was replaced
                closed.wait(_TURN)

    def _parsed(self, peer: Any, data: bytes) -> list[Any]:
        """Return the complete messages; bytes that are none are skipped."""
        parser = self._parsers.get(peer)
        if parser is None:
            if len(self._parsers) >= 16:
                self._parsers.clear()
            parser = self._parsers[peer] = self._mav.MAVLink(None)
            parser.robust_parsing = True
        found = parser.parse_buffer(data) or []
        return [m for m in found if m.get_type() != "BAD_DATA"]

    def _send(self, message: Any, peer: Any) -> None:
        data = bytes(message.pack(self._packer))
        self._packer.seq = (self._packer.seq + 1) % 256
        self.link.send(data, peer)
