"""A simulated vehicle over MAVLink, asked by MAVSDK 4 (in this process).

MAVSDK knows no flight modes of submarines: it sets none, and its calls that set a mode fail before
they send a message. Modes and MISSION_START are sent as commands here.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
import pytest

from tests.bridge.mavlink.ground import ME, piloted
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
from uuvsim_cosim.bridge.mavlink.vehicle import ORIGIN, global_of
from uuvsim_cosim.bridge.server.conductor import Conductor

mavsdk = pytest.importorskip("mavsdk")
_DO_SET_MODE, _MISSION_START, _WAYPOINT = 176, 300, 16
_GUIDED, _MANUAL, _POSHOLD = 4, 19, 16
_PLACES = ((2.0, 0.0, 3.0), (2.0, 2.0, 3.0))  # N E D [m]


class Station:
    """A program with MAVSDK, connected to a vehicle that runs at 5 times real time."""

    def __init__(self, sdk: Any, conductor: Conductor, server: MavlinkServer) -> None:
        self.conductor, self.services = conductor, server.ends[0].services
        port = server.ends[0].link.port
        assert sdk.add_any_connection(f"tcpout://127.0.0.1:{port}") == 0
        self.system = sdk.first_autopilot(PATIENCE)
        assert self.system is not None
        self.telemetry = self.plugin("telemetry", "Telemetry")

    def plugin(self, module: str, name: str) -> Any:
        found = __import__(f"mavsdk.plugins.{module}", fromlist=[name])
        return getattr(found, name)(self.system)

    def wait(self, stream: str, good: Callable[[Any], bool]) -> Any:
        values: SimpleQueue[Any] = SimpleQueue()
        subscribe = getattr(self.telemetry, f"subscribe_{stream}")
        handle = subscribe(lambda value, user: values.put(value))
        try:
            while not good(value := values.get(timeout=PATIENCE)):
                pass
        finally:
            getattr(self.telemetry, f"unsubscribe_{stream}")(handle)
        return value

    def place(self, good: Callable[[float, float, float], bool]) -> Any:
        def fits(both: Any) -> bool:
            p = both.position
            return good(p.north_m, p.east_m, p.down_m)

        return self.wait("position_velocity_ned", fits)

    def command(self, number: int, *values: float) -> int:
        from mavsdk.plugins.mavlink_direct import MavlinkMessage

        fields = {f"param{i}": v for i, v in enumerate((*values, *[0.0] * 7)[:7], start=1)}
        fields |= {"target_system": 1, "target_component": 1, "command": number, "confirmation": 0}
        asked = MavlinkMessage("COMMAND_LONG", 245, 190, 1, 1, json.dumps(fields))
        ack = self.plugin("mavlink_direct", "MavlinkDirect").send_command(asked)
        return int(json.loads(ack.fields_json)["result"])

    def arm(self, mode: int) -> None:
        assert self.command(_DO_SET_MODE, 1, mode) == 0
        self.plugin("action", "Action").arm()


@pytest.fixture
def station() -> Iterator[Station]:
    kind = mavsdk.ComponentType.GROUND_STATION
    with (
        Conductor(piloted()) as conductor,
        MavlinkServer(conductor, "tcpin:127.0.0.1:0") as server,
        mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind)) as sdk,
    ):
        running = conductor.ask("run", ME, None, 5.0, ())
        yield Station(sdk, conductor, server)
        assert not running.done() or running.exception() is None


def test_telemetry_is_the_state_of_the_hull(station: Station) -> None:
    station.conductor.pause(ME)
    eta = station.conductor.get(ME, ["hull.eta"])["hull.eta"]
    station.place(lambda *at: np.allclose(at, eta[:3], atol=1e-6))
    health = station.wait("health", lambda health: health.is_armable)
    assert health.is_local_position_ok
    assert not health.is_global_position_ok  # no fix of GPS under water
    assert station.wait("gps_info", lambda info: True).fix_type == 1


def test_arming_is_confirmed_and_seen(station: Station) -> None:
    action = station.plugin("action", "Action")
    action.arm()
    station.wait("armed", lambda armed: armed)
    action.disarm()
    station.wait("armed", lambda armed: not armed)


def test_parameters_are_read_set_and_listed(station: Station) -> None:
    param = station.plugin("param", "Param")
    param.set_param_float("HULL_M", 12.0)
    assert param.get_param_float("HULL_M") == 12.0
    assert station.conductor.get(ME, ["hull.m"])["hull.m"] == 12.0
    names = {p.name for p in param.get_all_params().float_params}
    outputs = {f"SERVO{i}_FUNCTION" for i in range(1, 9)} | {
        f"MOT_{i}_DIRECTION" for i in range(1, 9)
    }
    assert names == {"SYSID_THISMAV", "FRAME_CONFIG", *outputs, *station.services._parameters}


def test_a_mission_is_downloaded_as_it_was_uploaded(station: Station) -> None:
    from mavsdk.plugins.mission import MissionItem, MissionPlan

    mission = station.plugin("mission", "Mission")
    items = [
        MissionItem(*global_of(n, e, ORIGIN), -d, 0.5, is_fly_through=True) for n, e, d in _PLACES
    ]
    mission.upload_mission(MissionPlan(items))
    down = mission.download_mission().mission_items
    for sent, got in zip(items, down, strict=True):
        assert math.isclose(got.latitude_deg, sent.latitude_deg, abs_tol=1e-7)
        assert math.isclose(got.longitude_deg, sent.longitude_deg, abs_tol=1e-7)
        assert got.relative_altitude_m == sent.relative_altitude_m
        assert got.speed_m_s == sent.speed_m_s


def test_a_mission_is_started_and_flown_and_its_log_is_downloaded(
    station: Station, tmp_path: Path
) -> None:
    from mavsdk.plugins.mission_raw import MissionItem

    raw, logs = station.plugin("mission_raw", "MissionRaw"), station.plugin("log_files", "LogFiles")
    items = []
    for seq, (n, e, d) in enumerate([(0.0, 0.0, 0.0), *_PLACES]):
        x, y = (round(v * 1e7) for v in global_of(n, e, ORIGIN))
        items.append(MissionItem(seq, 3, _WAYPOINT, int(seq == 0), 1, 0, 0, 0, 0, x, y, -d, 0))
    raw.upload_mission(items)
    station.arm(_GUIDED)
    assert station.command(_MISSION_START) == 0
    station.place(lambda *at: math.dist(at, _PLACES[-1]) < 1.0)
    station.plugin("action", "Action").disarm()
    (entry,) = logs.get_entries()
    assert entry.size_bytes == len(station.services.logs[0].data)
    path = tmp_path / "1.BIN"
    results: SimpleQueue[Any] = SimpleQueue()
    logs.download_log_file_async(entry, str(path), lambda result, data, user: results.put(result))
    while (result := results.get(timeout=PATIENCE)).name == "NEXT":
        pass
    assert result.name == "SUCCESS"
    assert path.read_bytes() == bytes(station.services.logs[0].data)


def test_local_set_points_are_followed(station: Station) -> None:
    from mavsdk.plugins.offboard import PositionNedYaw, VelocityNedYaw

    station.arm(_GUIDED)
    offboard = station.plugin("offboard", "Offboard")
    offboard.set_position_ned(PositionNedYaw(1.0, 1.0, 3.0, 0.0))
    station.place(lambda *at: math.dist(at, (1.0, 1.0, 3.0)) < 0.1)
    offboard.set_velocity_ned(VelocityNedYaw(0.2, 0.0, 0.0, 0.0))
    station.wait("position_velocity_ned", lambda both: abs(both.velocity.north_m_s - 0.2) < 0.02)


def test_manual_control_moves_the_vehicle(station: Station) -> None:
    station.arm(_MANUAL)
    manual = station.plugin("manual_control", "ManualControl")

    def ahead(north: float, east: float, down: float) -> bool:
        manual.set_manual_control_input(1.0, 0.0, 0.5, 0.0)
        return north > 0.5

    station.place(ahead)
