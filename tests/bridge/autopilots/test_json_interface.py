"""Servo packets and lines of state: what is read, written and refused."""

from __future__ import annotations

import json
import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.bridge.autopilots.conftest import at_free_instance
from uuvsim_cosim.bridge.autopilots.json_interface import (
    JsonLink,
    read_servo_packet,
    state_line,
)
from uuvsim_cosim.errors import InputInvalid

WIDTHS = st.integers(0, 2**16 - 1)
FINITE = st.floats(-1e4, 1e4)


@given(st.sampled_from([(18458, 16), (29569, 32)]), WIDTHS, st.integers(0, 2**32 - 1), st.data())
def test_a_packet_is_read_as_it_was_written(
    kind: tuple[int, int], rate: int, frame: int, data: st.DataObject
) -> None:
    magic, channels = kind
    widths = data.draw(st.lists(WIDTHS, min_size=channels, max_size=channels))
    packet = read_servo_packet(struct.pack(f"<HHI{channels}H", magic, rate, frame, *widths))
    assert (packet.rate, packet.frame, packet.widths) == (rate, frame, tuple(widths))


@given(st.binary(max_size=100))
def test_other_bytes_are_refused_with_what_is_expected(data: bytes) -> None:
    known = {18458: 40, 29569: 72}
    magic = struct.unpack_from("<H", data)[0] if len(data) > 1 else None
    if known.get(magic or 0) == len(data):
        return
    with pytest.raises(InputInvalid, match=r"servo packet: .*; expected \d+"):
        read_servo_packet(data)


@given(st.lists(FINITE, min_size=23, max_size=23))
def test_a_line_is_json_between_line_ends_with_the_keys_in_the_order_of_the_example(
    x: list[float],
) -> None:
    line = state_line(x[0], x[1:4], x[4:7], x[7:10], x[10:13], x[13:17], x[17:20], *x[20:])
    assert line[:1] == line[-1:] == b"\n"
    assert line.count(b"\n") == 2
    read = json.loads(line)
    assert list(read) == [
        "timestamp", "imu", "position", "attitude", "quaternion", "velocity", "rng_1", "battery",
    ]  # fmt: skip
    assert list(read["imu"]) == ["gyro", "accel_body"]
    assert read["position"] == pytest.approx(x[7:10], rel=1e-11, abs=1e-11)
    assert read["battery"] == pytest.approx({"voltage": x[21], "current": x[22]}, rel=1e-8)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_state_that_is_not_finite_is_not_sent(bad: float) -> None:
    zero = [0.0] * 3
    with pytest.raises(InputInvalid, match="finite numbers"):
        state_line(0.0, zero, zero, [0.0, 0.0, bad], zero, [1, 0, 0, 0], zero, 0, 16, 0)


def test_a_port_that_another_program_has_is_named_with_the_next_instance() -> None:
    link = at_free_instance(lambda instance: JsonLink(instance, 1.0))
    n = (link.port - 9002) // 10
    try:
        with pytest.raises(InputInvalid, match=rf"UDP port {link.port} .*instance={n + 1}"):
            JsonLink(n, 1.0)
    finally:
        link.close()
