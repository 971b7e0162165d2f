"""Messages that are wrong, hostile or too many change nothing, and the vehicle goes on."""

from __future__ import annotations

import math
import random
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from tests.bridge.mavlink.ground import ME, Ground, grounded, mav, piloted
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.mavlink import missions
from uuvsim_cosim.bridge.mavlink.codec import Codec
from uuvsim_cosim.bridge.mavlink.services import Services
from uuvsim_cosim.bridge.mavlink.vehicle import vehicles_of
from uuvsim_cosim.bridge.server.conductor import Conductor

_GUIDED = 4
_ARM = mav.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


class Vehicle:
    """The services of a vehicle that stands still, and the messages that they have sent."""

    def __init__(self, conductor: Conductor) -> None:
        self.sent: list[Any] = []
        self._codec = Codec(mav, 1, 1)
        client = Client("test", "mavlink", frozenset({"read", "set"}))
        (vehicle,) = vehicles_of(conductor)
        self.services = Services(conductor, client, vehicle, 1, mav, self._send)
        self._from, self._to = Codec(mav, 255, 1), Codec(mav, 1, 1)

    def _send(self, message: Any, peer: Any) -> None:
        self._codec.packed(message)  # raises if a field cannot be packed
        self.sent.append(message)

    def take(self, message: Any) -> Any:
        """Pass a message as bytes; return the last answer."""
        self.sent.clear()
        for one in self._to.parsed("peer", self._from.packed(message)):
            self.services.handle(one, "peer")
        return self.sent[-1] if self.sent else None

    def mission_item(self, seq: int, **changed: float) -> Any:
        fields = {"target_system": 1, "target_component": 1, "seq": seq, "frame": 3, "command": 16,
                  "current": 0, "autocontinue": 1, "param1": 0, "param2": 0, "param3": 0,
                  "param4": 0, "x": 0, "y": 0, "z": 0, **changed}  # fmt: skip
        return self.take(mav.MAVLink_mission_item_int_message(**fields))


@pytest.fixture
def vehicle() -> Iterator[Vehicle]:
    with Conductor(piloted()) as conductor:
        yield Vehicle(conductor)


@pytest.fixture
def ground() -> Iterator[Ground]:
    with grounded() as station:
        yield station


def test_every_unknown_command_is_answered_unsupported(vehicle: Vehicle) -> None:
    known = {176, 224, 300, 400, 410, 510, 511, 512, 520}
    numbers = set(mav.enums["MAV_CMD"]) - known | {0, 65534}
    for number in numbers:
        for message in (
            mav.MAVLink_command_long_message(1, 1, number, 0, *[math.nan] * 7),
            mav.MAVLink_command_int_message(1, 1, 0, number, 0, 0, *[math.nan] * 4, 0, 0, math.inf),
        ):
            ack = vehicle.take(message)
            assert (ack.get_type(), ack.command) == ("COMMAND_ACK", number)
            assert ack.result == mav.MAV_RESULT_UNSUPPORTED


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_set_points_that_are_not_finite_are_ignored(vehicle: Vehicle, bad: float) -> None:
    services = vehicle.services
    services._set_mode(_GUIDED)
    for i in range(3):
        at = [1.0, 2.0, 3.0]
        at[i] = bad
        for frame in (1, 8):
            vehicle.take(
                mav.MAVLink_set_position_target_local_ned_message(
                    0, 1, 1, frame, 0xDF8, *at, 0, 0, 0, 0, 0, 0, 0, 0
                )
            )
            vehicle.take(
                mav.MAVLink_set_position_target_local_ned_message(
                    0, 1, 1, frame, 0xDC7, 0, 0, 0, *at, 0, 0, 0, 0, 0
                )
            )
    vehicle.take(
        mav.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0x9F8, 1, 1, 1, 0, 0, 0, 0, 0, 0, bad, 0
        )
    )
    for q, thrust in (([bad, 0, 0, 0], 0.5), ([0, 0, 0, 0], 0.5), ([1, 0, 0, 0], bad)):
        vehicle.take(mav.MAVLink_set_attitude_target_message(0, 1, 1, 0, q, 0, 0, 0, thrust))
    assert services._target is None
    assert services._velocity is None


@pytest.mark.parametrize(
    ("changed", "result"),
    [
        ({"x": 900_000_001}, mav.MAV_MISSION_INVALID_PARAM5_X),
        ({"y": -1_800_000_001}, mav.MAV_MISSION_INVALID_PARAM6_Y),
        ({"z": math.nan}, mav.MAV_MISSION_INVALID_PARAM7),
        ({"frame": 77}, mav.MAV_MISSION_UNSUPPORTED_FRAME),
    ],
)
def test_a_mission_with_a_wrong_place_is_refused_and_the_old_one_stays(
    vehicle: Vehicle, changed: dict[str, float], result: int
) -> None:
    vehicle.services.set_mission([(1.0, 0.0, 2.0)])
    kept = vehicle.services.missions.items
    assert vehicle.take(mav.MAVLink_mission_count_message(1, 1, 3, 0)).seq == 0
    assert vehicle.mission_item(0, **changed).type == result
    assert vehicle.services.missions.items is kept


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, 1e30), (91.0, 0.0), (0.0, -math.inf)])
def test_a_waypoint_in_degrees_with_a_wrong_place_is_refused(
    vehicle: Vehicle, place: tuple[float, float]
) -> None:
    vehicle.take(mav.MAVLink_mission_count_message(1, 1, 1, 0))
    item = mav.MAVLink_mission_item_message(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, *place, -1.0, 0)
    wrong = (mav.MAV_MISSION_INVALID_PARAM5_X, mav.MAV_MISSION_INVALID_PARAM6_Y)
    assert vehicle.take(item).type in wrong
    assert vehicle.services.missions.items == []


def test_an_upload_that_stops_is_given_up(
    vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(missions, "monotonic", lambda: now[0])
    for count in (701, 65535):
        refused = vehicle.take(mav.MAVLink_mission_count_message(1, 1, count, 0))
        assert refused.type == mav.MAV_MISSION_NO_SPACE
    assert vehicle.take(mav.MAVLink_mission_count_message(1, 1, 700, 0)).seq == 0
    assert vehicle.mission_item(0).seq == 1
    assert vehicle.mission_item(699).seq == 1  # out of order: the missing one is requested again
    for _ in range(20):
        now[0] += 1.0
        vehicle.services.missions.poll()
    last = vehicle.sent[-1]
    assert (last.get_type(), last.type) == ("MISSION_ACK", mav.MAV_MISSION_OPERATION_CANCELLED)
    assert vehicle.mission_item(1) is None  # an item without an upload
    assert vehicle.services.missions.items == []


def test_parts_of_a_message_and_wrong_bytes_are_no_message() -> None:
    sender = Codec(mav, 255, 1)
    whole = sender.packed(_ARM)
    for i in range(len(whole)):
        receiver = Codec(mav, 1, 1)
        assert receiver.parsed("peer", whole[:i]) == []
        # The frame that was begun ends within 300 bytes; what follows is read.
        receiver.parsed("peer", b"\0" * 300)
        assert len(receiver.parsed("peer", whole)) == 1
        wrong = bytearray(whole)
        wrong[i] ^= 0x55
        found = Codec(mav, 1, 1).parsed("peer", bytes(wrong) + b"\0" * 300)
        assert [m for m in found if m.get_type() == "COMMAND_LONG"] == []


def test_any_field_of_any_request_may_have_any_value(vehicle: Vehicle) -> None:
    chance = random.Random(7)
    answered = [n[4:].upper() for n in dir(vehicle.services) if n.startswith("_on_")]
    kinds = {k.msgname: k for k in mav.mavlink_map.values()}
    names = [*answered, *(n for n in kinds if n.startswith("MISSION_"))]
    for turn in range(3000):
        kind = kinds[chance.choice(names)]
        length = kind.unpacker.size
        payload = bytearray(chance.randbytes(length))
        for _ in range(chance.randrange(4)):  # NaN, infinity, -1 and 0
            at = chance.randrange(max(1, length - 3))
            special = (b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xff\xff\xff\xff", b"\0\0\0\0")
            payload[at : at + 4] = chance.choice(special)
        payload = payload[:length]
        head = bytes((length, 0, 0, 0, 255, 1)) + kind.id.to_bytes(3, "little")
        check = mav.x25crc(head + payload + bytes((kind.crc_extra,))).crc
        frame = b"\xfd" + head + payload + check.to_bytes(2, "little")
        (message,) = Codec(mav, 1, 1).parsed("peer", frame)
        for name in ("target_system", "target_component", "target"):
            if hasattr(message, name):
                setattr(message, name, chance.choice((0, 1)))
        if hasattr(message, "command"):
            message.command = chance.choice((400, 176, 300, 224, 510, 511, 512, 520, 410, 16))
        if kind.msgname.startswith("MISSION_ITEM"):  # an upload is in progress
            message.seq, message.mission_type = len(vehicle.services.missions._incoming), 0
        if kind.msgname == "MISSION_COUNT":
            message.count, message.mission_type = chance.choice((1, 2)), 0
        vehicle.take(message)
        if turn % 100 == 0:
            vehicle.services.turn()


def test_a_flood_is_survived_and_the_run_goes_on(ground: Ground) -> None:
    asking = mav.MAVLink_ping_message(0, 0, 0, 0).pack(ground.link.mav)
    before = ground.conductor.moment().time
    for _ in range(40):
        ground.link.write(bytes(asking) * 100)
        ground.link.recv_match()
    after = ground.wait("LOCAL_POSITION_NED", lambda m: m.time_boot_ms > 1e3 * before)
    ack = None
    while ack is None:  # at the end of the flood a command may be dropped: it is sent again
        ground.link.mav.command_long_send(1, 1, mav.MAV_CMD_NAV_TAKEOFF, 0, *[0.0] * 7)
        ack = ground.link.recv_match(type="COMMAND_ACK", blocking=True, timeout=1.0)
    assert ack.result == mav.MAV_RESULT_UNSUPPORTED
    assert ground.conductor.moment().time >= 1e-3 * after.time_boot_ms


def test_logs_of_a_flood_of_arming_are_limited(vehicle: Vehicle) -> None:
    for _ in range(200):
        vehicle.services._arm(True)
        vehicle.services._arm(False)
    assert len(vehicle.services.logs) == 64


def test_the_server_goes_on_after_a_reset(ground: Ground) -> None:
    ground.wait("HEARTBEAT")
    ground.conductor.pause(ME)
    ground.conductor.reset(ME)
    ground.wait("LOCAL_POSITION_NED", lambda m: m.time_boot_ms == 0)


def test_a_log_is_sent_as_fast_as_the_peer_reads_it(ground: Ground) -> None:
    ground.wait("HEARTBEAT")
    services, (peer,) = ground.server.ends[0].services, ground.server.ends[0].link.peers
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 16)
    ground.link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
    services._arm(True)
    services._arm(False)
    whole = services.logs[0].data = bytearray(random.Random(3).randbytes(1_000_000))
    ground.link.mav.log_request_data_send(1, 1, 1, 0, len(whole))
    full, asked = threading.Semaphore(0), services._has_room

    def has_room(peer: Any) -> bool:
        if not (room := asked(peer)):
            full.release()
        return room

    services._has_room = has_room
    for _ in range(1000):  # the peer reads nothing until its buffer has been full for long
        assert full.acquire(timeout=PATIENCE)
    data = bytearray()
    while len(data) < len(whole):
        part = ground.wait("LOG_DATA")
        assert part.ofs == len(data)
        data += bytes(part.data[: part.count])
    assert data == whole
