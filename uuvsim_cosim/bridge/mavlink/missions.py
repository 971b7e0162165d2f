"""The mission protocol of MAVLink: upload, download, current item and clearing.

As ArduPilot has it, item 0 is the home position, which is not a waypoint of the path.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from time import monotonic
from typing import Any, final

__all__ = ["Missions"]

_ITEMS = 700  # of a mission at most
_AGAIN = 0.5  # [s] after which a missing item is requested again
_GIVEN_UP = 10  # requests of the same item
WAYPOINT = 16  # MAV_CMD_NAV_WAYPOINT


@final
class Missions:
    """The mission of one vehicle; `send` sends a message to a peer.

    `items` are the MISSION_ITEM_INT messages, `current` is the number of the item that is next.
    """

    def __init__(self, mav: Any, send: Callable[[Any, Any], None]) -> None:
        self._mav, self._send = mav, send
        self.items: list[Any] = []
        self.current = 0
        self._incoming: list[Any] = []
        self._count = 0
        self._from: Any = None  # peer and ids of the upload in progress
        self._requested, self._tries = 0.0, 0

    def handle(self, name: str, m: Any, peer: Any) -> bool:
        """Answer a message of the mission protocol; return whether it was one."""
        mav, who = self._mav, (m.get_srcSystem(), m.get_srcComponent())
        if getattr(m, "mission_type", 0) != 0 and name.startswith("MISSION_"):
            if name == "MISSION_REQUEST_LIST":  # fences and rally points: there are none
                self._send(mav.MAVLink_mission_count_message(*who, 0, m.mission_type), peer)
            elif name in ("MISSION_COUNT", "MISSION_CLEAR_ALL"):
                self._ack(mav.MAV_MISSION_UNSUPPORTED, who, peer, m.mission_type)
            return True
        if name == "MISSION_COUNT":
            if m.count > _ITEMS:
                self._ack(mav.MAV_MISSION_NO_SPACE, who, peer)
            elif m.count == 0:
                self.items, self.current = [], 0
                self._ack(mav.MAV_MISSION_ACCEPTED, who, peer)
            else:
                self._incoming, self._count, self._from = [], m.count, (peer, who)
                self._request()
        elif name in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            self._item(name, m, who, peer)
        elif name == "MISSION_REQUEST_LIST":
            self._send(mav.MAVLink_mission_count_message(*who, len(self.items), 0), peer)
        elif name in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            if m.seq >= len(self.items):
                self._ack(mav.MAV_MISSION_INVALID_SEQUENCE, who, peer)
            else:
                i = self.items[m.seq]
                self._send(
                    mav.MAVLink_mission_item_int_message(
                        *who, m.seq, i.frame, i.command, int(m.seq == self.current),
                        i.autocontinue, i.param1, i.param2, i.param3, i.param4, i.x, i.y, i.z, 0,
                    ),
                    peer,
                )  # fmt: skip
        elif name == "MISSION_CLEAR_ALL":
            self.items, self.current = [], 0
            self._ack(mav.MAV_MISSION_ACCEPTED, who, peer)
        elif name == "MISSION_SET_CURRENT":
            self.set_current(m.seq)
            self._send(self.status(), peer)
        else:
            return name == "MISSION_ACK"
        return True

    def set_current(self, number: int) -> bool:
        """Make an item the next one; return whether it exists."""
        if not 0 <= number < len(self.items):
            return False
        self.current = number
        return True

    def status(self) -> Any:
        """Return MISSION_CURRENT."""
        return self._mav.MAVLink_mission_current_message(self.current, len(self.items))

    def poll(self) -> None:
        """Request a missing item again; an upload without answers is given up."""
        if self._from is None or monotonic() - self._requested < _AGAIN:
            return
        if self._tries >= _GIVEN_UP:
            (peer, who), self._from = self._from, None
            self._ack(self._mav.MAV_MISSION_OPERATION_CANCELLED, who, peer)
        else:
            self._request(again=True)

    def _item(self, name: str, m: Any, who: tuple[int, int], peer: Any) -> None:
        mav = self._mav
        if self._from is None or self._from != (peer, who):
            return
        if m.seq != len(self._incoming):  # repeated or out of order: it is requested again
            self._request(again=True)
            return
        scale = 1e7 if name == "MISSION_ITEM" else 1.0  # degrees, or 1e-7 degrees
        if m.command == WAYPOINT:
            wrong = None
            if m.frame not in (0, 3, 5, 6):  # altitude above mean sea level or home
                wrong = mav.MAV_MISSION_UNSUPPORTED_FRAME
            elif not abs(m.x) * scale <= 90e7:  # NaN too
                wrong = mav.MAV_MISSION_INVALID_PARAM5_X
            elif not abs(m.y) * scale <= 180e7:
                wrong = mav.MAV_MISSION_INVALID_PARAM6_Y
            elif not isfinite(m.z):
                wrong = mav.MAV_MISSION_INVALID_PARAM7
            if wrong is not None:
                self._from = None
                self._ack(wrong, who, peer)
                return
        if name == "MISSION_ITEM":
            x, y = (round(v * scale) if abs(v) <= 180.0 else 0 for v in (m.x, m.y))
            m = mav.MAVLink_mission_item_int_message(
                0, 0, m.seq, m.frame, m.command, 0, m.autocontinue, m.param1, m.param2, m.param3,
                m.param4, x, y, m.z, 0,
            )  # fmt: skip
        self._incoming.append(m)
        if len(self._incoming) < self._count:
            self._request()
            return
        self.items, self.current, self._from = self._incoming, 0, None
        self._ack(mav.MAV_MISSION_ACCEPTED, who, peer)

    def _request(self, *, again: bool = False) -> None:
        peer, who = self._from
        self._requested, self._tries = monotonic(), self._tries + 1 if again else 0
        number = len(self._incoming)
        self._send(self._mav.MAVLink_mission_request_int_message(*who, number, 0), peer)

    def _ack(self, result: int, who: tuple[int, int], peer: Any, kind: int = 0) -> None:
        self._send(self._mav.MAVLink_mission_ack_message(*who, result, kind), peer)
