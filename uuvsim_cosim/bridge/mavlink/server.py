"""The MAVLink end of a server: one thread for each vehicle of the system."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, final

from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.mavlink.codec import Codec, key_of_environment
from uuvsim_cosim.bridge.mavlink.link import DEFAULT, Address, Link, dialect
from uuvsim_cosim.bridge.mavlink.services import Services
from uuvsim_cosim.bridge.mavlink.vehicle import Vehicle, vehicles_of
from uuvsim_cosim.closing import Owner, started
from uuvsim_cosim.errors import UuvsimError

__all__ = ["MavlinkServer"]

_log = logging.getLogger("uuvsim_cosim.mavlink")
_TURN = 0.05  # [s] between two turns of a vehicle
_MESSAGES = 256  # from one peer that are answered in a turn; further ones are dropped


class MavlinkServer(Owner):
    """The vehicles of a co-simulation over MAVLink, from construction to `close`.

    Vehicle k (from 0) has system id 1 + k and a port that is 10 k higher. The first one has the
    `mission` (n, 3): north, east, down [m]; the `origin` of its frame is (lat, lon) [deg]. With a
    key (see `codec`), messages are signed, and the first one without a valid signature is reported.
    Raises InputInvalid without pymavlink, without a hull, and for an address that cannot be opened.
    """

    def __init__(
        self,
        service: Service,
        address: str = DEFAULT,
        *,
        anyone: bool = False,
        mission: Sequence[Sequence[float]] | None = None,
        origin: tuple[float, float] | None = None,
        report: Callable[[str], None] = _log.warning,
    ) -> None:
        mav, key = dialect(), key_of_environment()
        first = Address.of(address, anyone=anyone)
        self._closed = threading.Event()
        self.ends: list[_End] = []
        threads: list[threading.Thread] = []
        with self._opening() as opened:
            for number, vehicle in enumerate(vehicles_of(service)):
                link = opened.enter_context(Link(first.instance(number)))
                self.ends.append(_End(service, vehicle, number + 1, mav, link, key, report))
            services = [end.services for end in self.ends]
            if origin is not None:
                for one in services:
                    one.origin = origin
            if mission is not None:
                services[0].set_mission(mission)

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
        self,
        service: Service,
        vehicle: Vehicle,
        system_id: int,
        mav: Any,
        link: Link,
        key: bytes | None,
        report: Callable[[str], None],
    ) -> None:
        self.link = link
        self._codec = Codec(mav, system_id, 1, key, self._refused)
        self._report = report
        client = Client(f"mavlink-{system_id}", "mavlink", frozenset({"read", "set"}))
        self.services = Services(
            service, client, vehicle, system_id, mav, self._send, link.has_room
        )

    def serve(self, closed: threading.Event) -> None:
        """Answer messages and send the state until `closed` is set or the co-simulation ends."""
        next_turn = 0.0
        while not closed.is_set():
            now = time.monotonic()
            wait = 0.001 if self.services.is_busy else max(0.0, next_turn - now)
            try:
                for peer, data in self.link.receive(wait):
                    for message in self._codec.parsed(peer, data)[:_MESSAGES]:
                        self.services.handle(message, peer)
                if self.services.is_busy or time.monotonic() >= next_turn:
                    next_turn = time.monotonic() + _TURN
                    self.services.turn()
            except UuvsimError:  # the co-simulation has ended, or a component was replaced
                closed.wait(_TURN)

    def _refused(self, text: str) -> None:
        self._report(f"{self.link.address}: {text}")
        self.services.report(text)

    def _send(self, message: Any, peer: Any) -> None:
        self.link.send(self._codec.packed(message), peer)
