"""A simulated vehicle over MAVLink, asked by pymavlink as a ground station asks ArduSub."""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridge.mavlink.ground import ME, Ground, grounded, mav, mavutil
from uuvsim_cosim.bridge.mavlink.link import Address, Link
from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
from uuvsim_cosim.bridge.mavlink.vehicle import ORIGIN, State, global_of, local_of, messages_of
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.logs import read_log


@pytest.fixture
def ground() -> Iterator[Ground]:
    with grounded() as station:
        yield station


def test_state_is_that_of_the_hull(ground: Ground) -> None:
    beat = ground.wait("HEARTBEAT")
    assert (beat.type, beat.autopilot) == (mav.MAV_TYPE_SUBMARINE, mav.MAV_AUTOPILOT_ARDUPILOTMEGA)
    ground.conductor.pause(ME)
    at = round(ground.conductor.moment().time * 1e3)
    local = ground.wait("LOCAL_POSITION_NED", lambda m: m.time_boot_ms == at)
    attitude = ground.wait("ATTITUDE", lambda m: m.time_boot_ms == at)
    eta = ground.conductor.get(ME, ["hull.eta"])["hull.eta"]
    sent = [local.x, local.y, local.z, attitude.roll, attitude.pitch, attitude.yaw]
    assert np.allclose(sent, eta, atol=1e-6, rtol=1e-6)
    pressure = ground.wait("SCALED_PRESSURE2").press_abs * 100.0
    assert pressure == pytest.approx(101325.0 + 1025.0 * 9.80665 * eta[2], rel=1e-6)


def test_commands_are_accepted_denied_or_unsupported(ground: Ground) -> None:
    assert ground.command(mav.MAV_CMD_NAV_TAKEOFF) == mav.MAV_RESULT_UNSUPPORTED
    assert ground.command(mav.MAV_CMD_DO_SET_MODE, 1, 12) == mav.MAV_RESULT_DENIED
    assert ground.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, math.nan) == mav.MAV_RESULT_DENIED
    ground.arm(4)
    armed = mav.MAV_MODE_FLAG_SAFETY_ARMED
    ground.wait("HEARTBEAT", lambda m: m.base_mode & armed and m.custom_mode == 4)
    assert ground.command(mav.MAV_CMD_REQUEST_MESSAGE, 148) == mav.MAV_RESULT_ACCEPTED
    assert ground.wait("AUTOPILOT_VERSION").capabilities & mav.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    assert ground.command(mav.MAV_CMD_REQUEST_MESSAGE, 9999) == mav.MAV_RESULT_UNSUPPORTED
    assert ground.command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 200_000) == 0
    assert ground.command(mav.MAV_CMD_GET_MESSAGE_INTERVAL, 30) == 0
    assert ground.wait("MESSAGE_INTERVAL").interval_us == 200_000
    ground.link.mav.timesync_send(0, 77)
    assert ground.wait("TIMESYNC", lambda m: m.tc1 != 0).ts1 == 77


def test_parameters_are_listed_read_and_set(ground: Ground) -> None:
    ground.link.mav.param_request_list_send(1, 1)
    first = ground.wait("PARAM_VALUE")
    names = {first.param_id}
    while len(names) < first.param_count:
        names.add(ground.wait("PARAM_VALUE").param_id)
    assert "HULL_M" in names
    ground.link.mav.param_set_send(1, 1, b"HULL_M", 12.0, 9)
    assert ground.wait("PARAM_VALUE", lambda m: m.param_id == "HULL_M").param_value == 12.0
    assert ground.conductor.get(ME, ["hull.m"])["hull.m"] == 12.0
    ground.link.mav.param_set_send(1, 1, b"HULL_M", math.nan, 9)
    assert ground.wait("PARAM_VALUE", lambda m: m.param_id == "HULL_M").param_value == 12.0


def test_manual_control_moves_the_vehicle_and_ends_by_silence(ground: Ground) -> None:
    ground.arm(19)
    start = ground.wait("LOCAL_POSITION_NED")
    ahead = start
    while ahead.x < start.x + 0.5:
        ground.link.mav.manual_control_send(1, 1000, 0, 500, 0, 0)
        ahead = ground.wait("LOCAL_POSITION_NED")
    still = ground.wait("LOCAL_POSITION_NED", lambda m: math.hypot(m.vx, m.vy) < 0.02)
    assert still.x > start.x + 0.5


def test_guided_set_point_is_reached(ground: Ground) -> None:
    ground.arm(4)
    ground.link.mav.set_position_target_local_ned_send(
        0, 1, 1, 1, 0xDF8, math.nan, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    ground.link.mav.set_position_target_local_ned_send(
        0, 1, 1, 1, 0xDF8, 1.0, 1.0, 3.0, 0, 0, 0, 0, 0, 0, 0, 0
    )
    near = ground.wait("LOCAL_POSITION_NED", lambda m: math.dist((m.x, m.y, m.z), (1, 1, 3)) < 0.1)
    eta = ground.conductor.get(ME, ["hull.eta"])["hull.eta"]
    assert math.dist((near.x, near.y, near.z), eta[:3]) < 0.5


def test_mission_is_uploaded_flown_and_downloaded_and_its_log_is_read(
    ground: Ground, tmp_path: Path
) -> None:
    items = [ground.item(0, 0, 0, 0), ground.item(1, 2, 0, 3), ground.item(2, 2, 2, 3)]
    assert ground.upload(items) == mav.MAV_MISSION_ACCEPTED
    ground.link.mav.mission_request_list_send(1, 1, 0)
    assert ground.wait("MISSION_COUNT").count == 3
    ground.link.mav.mission_request_int_send(1, 1, 2, 0)
    got = ground.wait("MISSION_ITEM_INT")
    assert (got.x, got.y, got.z) == (items[2].x, items[2].y, -3.0)
    ground.arm(2)
    assert ground.command(mav.MAV_CMD_MISSION_START, 0, 0) == mav.MAV_RESULT_ACCEPTED
    ground.wait("MISSION_ITEM_REACHED", lambda m: m.seq == 2)
    assert ground.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 0) == mav.MAV_RESULT_ACCEPTED

    ground.link.mav.log_request_list_send(1, 1, 0, 0xFFFF)
    entry = ground.wait("LOG_ENTRY")
    ground.link.mav.log_request_data_send(1, 1, entry.id, 0, entry.size)
    data = bytearray()
    while len(data) < entry.size:
        part = ground.wait("LOG_DATA")
        assert part.ofs == len(data)
        data += bytes(part.data[: part.count])
    path = tmp_path / "1.BIN"
    path.write_bytes(data)
    read = read_log(path)
    assert {"eta", "nu", "u"} <= set(read.values_by_name)
    assert read.metadata["vehicle"] == "bluerov2_heavy"
    thrust_up = read["u"][:, 4:].sum(axis=1)  # positive at first: it dives, so the sum is negative
    assert thrust_up[read.time < 1.0].mean() < 0.0
    depth = read.values_by_name["eta"][:, 2]
    assert np.nanmax(depth) == pytest.approx(3.0, abs=1.0)
    kinds = set()
    log = mavutil.mavlink_connection(str(path))
    while (m := log.recv_match()) is not None:
        kinds.add(m.get_type())
    log.close()
    assert {"FMT", "FMTU", "UNIT", "MULT", "PARM", "ATT", "IMU", "XKF1", "RCOU", "CTUN"} <= kinds


def test_a_mission_with_a_wrong_frame_or_too_many_items_is_refused(ground: Ground) -> None:
    wrong = ground.item(0, 0, 0, 0)
    wrong.frame = 99
    assert ground.upload([wrong]) == mav.MAV_MISSION_UNSUPPORTED_FRAME
    ground.link.mav.mission_count_send(1, 1, 60000, 0)
    assert ground.wait("MISSION_ACK").type == mav.MAV_MISSION_NO_SPACE


def test_noise_wrong_checksums_and_other_ids_change_nothing(ground: Ground) -> None:
    other = ground.link.mav.command_long_encode(9, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    wrong = bytearray(mav.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
                      .pack(ground.link.mav))  # fmt: skip
    wrong[-1] ^= 0xFF
    ground.link.mav.send(other)
    ground.link.write(os.urandom(50_000))
    ground.link.write(bytes(wrong) + b"\xfd\x10")
    ground.link.write(b"\x00" * 300)  # the end of a frame whose head the noise contained
    assert ground.command(mav.MAV_CMD_NAV_TAKEOFF) == mav.MAV_RESULT_UNSUPPORTED
    beat = ground.wait("HEARTBEAT")
    assert not beat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED


def test_without_a_pilot_the_vehicle_is_only_observed() -> None:
    with (
        Conductor("bluerov2_hold") as conductor,
        MavlinkServer(conductor, "tcpin:127.0.0.1:0") as server,
    ):
        station = Ground(conductor, server.ends[0].link.port)
        denied = station.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        assert denied == mav.MAV_RESULT_DENIED
        station.link.close()


def test_an_occupied_port_and_a_wrong_address_are_refused() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(InputInvalid, match="cannot be opened"):
            Link(Address.of(f"udpin:127.0.0.1:{port}"))
    for text in ("serial:/dev/x", "udpin:127.0.0.1", "udpout:127.0.0.1:99999", ""):
        with pytest.raises(InputInvalid, match="expected FORM:HOST:PORT"):
            Address.of(text)
    with pytest.raises(InputInvalid, match="without authentication"):
        Address.of("udpin:0.0.0.0:14550")
    assert Address.of("udpin:0.0.0.0:14550", anyone=True).host == "0.0.0.0"


def _gps(depth: float, **sensed: Any) -> Any:
    state = State(1.0, (3.0, 4.0, depth, 0.0, 0.0, 0.0), (0.0,) * 6, (0.0,) * 6, **sensed)
    return messages_of(mav, state, ORIGIN)["GPS_RAW_INT"]


def test_gps_has_a_fix_only_at_the_surface() -> None:
    lat, lon = (round(x * 1e7) for x in global_of(3.0, 4.0, ORIGIN))
    above = _gps(0.1)
    assert (above.fix_type, above.lat, above.lon, above.satellites_visible) == (3, lat, lon, 10)
    for depth in (0.3, 10.0):
        below = _gps(depth)
        assert (below.fix_type, below.lat, below.lon, below.satellites_visible) == (1, 0, 0, 0)


def test_gps_is_that_of_the_systems_receiver() -> None:
    lat, lon = (round(x * 1e7) for x in global_of(3.5, 4.5, ORIGIN))
    found = _gps(0.1, gps_position=(3.5, 4.5, -0.2), gps_valid=1.0)
    assert (found.fix_type, found.lat, found.lon) == (3, lat, lon)
    assert _gps(0.1, gps_position=(3.5, 4.5, -0.2), gps_valid=0.0).fix_type == 1


@pytest.mark.parametrize("place", [(0.0, 0.0), (100.0, -2000.0), (-3.0, 5.0)])
def test_local_and_global_places_are_inverses(place: tuple[float, float]) -> None:
    origin = (33.8, -118.4)
    assert local_of(*global_of(*place, origin), origin) == pytest.approx(place, abs=1e-6)
