"""The exchange with PX4 by TCP, with a peer in the test; frames of the PX4 end and pymavlink."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from tests.bridge.autopilots.conftest import at_free_instance
from tests.bridge.autopilots.fake_px4 import SENSOR, Reader, Writer
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.autopilots.hil_interface import HilLink
from uuvsim_cosim.bridge.autopilots.json_interface import AutopilotLost
from uuvsim_cosim.errors import InputInvalid


def alive(wait: float = 0.0) -> None:
    """The autopilot has not ended."""


@pytest.fixture
def pair() -> Iterator[tuple[HilLink, socket.socket]]:
    """A link and the connection of its peer."""
    link = at_free_instance(lambda instance: HilLink(instance, PATIENCE))
    with socket.create_connection(("127.0.0.1", 4560 + link.instance)) as peer:
        link.accept(alive)
        yield link, peer
    link.close()


def sensor(link: HilLink, time_us: int) -> None:
    link.add(
        link.dialect.MAVLink_hil_sensor_message(
            time_us, 0.5, -0.25, -9.75, 1, 2, 3, 0.125, 0, 0.5, 1513.5, 0, -5, 10, 0x1BFF
        )
    )


def test_the_frames_of_both_codecs_are_those_of_the_other(
    pair: tuple[HilLink, socket.socket],
) -> None:
    link, peer = pair
    sensor(link, 2501)
    peer.sendall(Writer(1).actuators(2501, [0.5] + [0.0] * 14 + [-1.0], True, 1))
    found = link.exchange(2501, alive)
    assert (found.time, found.armed) == (2501, True)
    assert found.controls == (0.5, *[0.0] * 14, -1.0)
    [(number, m)] = Reader().read(peer.recv(1000))
    assert number == SENSOR
    assert (m["time_usec"], m["zacc"], m["ymag"], m["id"]) == (2501, -9.75, 0.0, 0)
    assert (m["abs_pressure"], m["temperature"]) == (1513.5, 10.0)
    packed = ardupilotmega.MAVLink(None).parse_buffer(Writer(1).heartbeat(6, True))
    assert (packed[0].custom_mode, packed[0].base_mode) == (6 << 16, 129)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:20] + b"\x01" + data[21:], "wrong CRC"),
        (lambda data: b"\xfe" + data[1:], "magic 0xfe"),
        (lambda data: data + data, "sequence 0, expected 1"),
    ],
)
def test_the_px4_end_refuses_frames_that_are_damaged_or_repeated(
    pair: tuple[HilLink, socket.socket], change: object, message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    link, peer = pair
    sensor(link, 1)
    link.first(0.0, alive)
    assert callable(change)
    with pytest.raises(SystemExit, match="3"):
        Reader().read(change(peer.recv(1000)))
    assert message in capsys.readouterr().out


def test_an_answer_counts_from_the_clock_or_from_the_first_sensor(
    pair: tuple[HilLink, socket.socket],
) -> None:
    link, peer = pair
    writer = Writer(1)
    for time_us, answer in ((2501, 2501), (5001, 5000)):
        peer.sendall(writer.actuators(answer, [0.0] * 16, False, 1))
        assert link.exchange(time_us, alive).time == answer


def test_answers_of_earlier_times_and_other_messages_are_skipped_and_counted(
    pair: tuple[HilLink, socket.socket],
) -> None:
    link, peer = pair
    writer = Writer(1)
    for time_us in (2501, 2501, 5001):
        peer.sendall(writer.heartbeat(1, False) + writer.actuators(time_us, [0.0] * 16, False, 1))
    peer.sendall(b"nonsense" + writer.actuators(7501, [0.0] * 16, False, 1))
    assert link.exchange(7501, alive).time == 7501
    assert link.counts["stale"] == link.counts["other"] == 3
    assert link.counts["invalid"] > 0
    assert link.received == 1


def test_before_the_first_output_nothing_is_waited_for(
    pair: tuple[HilLink, socket.socket],
) -> None:
    link, peer = pair
    sensor(link, 1)
    assert link.first(0.001, alive) is None
    assert len(Reader().read(peer.recv(1000))) == 1
    peer.sendall(Writer(1).actuators(1, [0.0] * 16, False, 1))
    found = link.first(PATIENCE, alive)
    assert found is not None


def test_a_peer_that_reads_nothing_is_named() -> None:
    link = at_free_instance(lambda instance: HilLink(instance, 0.2))
    with socket.create_connection(("127.0.0.1", 4560 + link.instance)):
        link.accept(alive)
        link._written += bytes(1 << 26)  # more than the buffers between the two
        with pytest.raises(AutopilotLost, match=r"it has read nothing for 0.2 s"):
            link.first(0.0, alive)
    link.close()


def test_a_port_in_use_is_named_with_the_way_to_another(
    pair: tuple[HilLink, socket.socket],
) -> None:
    n = pair[0].instance
    with pytest.raises(InputInvalid, match=rf"TCP port {4560 + n} .* px4:\?instance={n + 1}"):
        HilLink(n, 1.0)
    pair[0]._listener.close()
    with pytest.raises(InputInvalid, match=rf"UDP port {14540 + n} .* used by another program"):
        HilLink(n, 1.0)


def test_it_listens_to_this_machine_only() -> None:
    link = at_free_instance(lambda instance: HilLink(instance, 1.0))
    assert link._listener.getsockname()[0] == link.onboard.getsockname()[0] == "127.0.0.1"
    link.close()


def test_a_short_payload_is_filled_with_zeros() -> None:
    frame = Writer(1).frame(SENSOR, 108, struct.pack("<Q", 5))
    [(_, m)] = Reader().read(frame)
    assert (m["time_usec"], m["abs_pressure"]) == (5, 0.0)
