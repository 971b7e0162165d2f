"""A ground station for tests: pymavlink's connection, and the waiting for an answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.http.keyboard import with_keyboards
from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
from uuvsim_cosim.bridge.mavlink.vehicle import global_of
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.system.system import System

mavutil = pytest.importorskip("pymavlink.mavutil")
mav = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
ME = Client("test", "local")


class Ground:
    """A ground station of the vehicle with this system id."""

    server: MavlinkServer

    def __init__(self, conductor: Conductor, port: int, vehicle: int = 1) -> None:
        self.conductor, self.vehicle = conductor, vehicle
        self.link = mavutil.mavlink_connection(
            f"tcp:127.0.0.1:{port}", source_system=255, dialect="ardupilotmega"
        )
        self.link.mav.heartbeat_send(6, 8, 0, 0, 4)

    def wait(self, kind: str, good: Callable[[Any], bool] = lambda m: True) -> Any:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            message = self.link.recv_match(type=kind, blocking=True, timeout=1.0)
            if message is not None and good(message):
                return message
        raise AssertionError(f"no {kind}")

    def command(self, number: int, *values: float) -> int:
        given = (*values, *[0.0] * 7)[:7]
        self.link.mav.command_long_send(self.vehicle, 1, number, 0, *given)
        return int(self.wait("COMMAND_ACK", lambda m: m.command == number).result)

    def arm(self, mode: int) -> None:
        assert self.command(mav.MAV_CMD_DO_SET_MODE, 1, mode) == mav.MAV_RESULT_ACCEPTED
        assert self.command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mav.MAV_RESULT_ACCEPTED

    def item(self, seq: int, n: float, e: float, d: float) -> Any:
        lat, lon = global_of(n, e, (33.810313, -118.393867))
        return mav.MAVLink_mission_item_int_message(
            1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, round(lat * 1e7), round(lon * 1e7), -d, 0
        )

    def upload(self, items: list[Any]) -> int:
        self.link.mav.mission_count_send(1, 1, len(items), 0)
        while True:
            m = self.wait("MISSION_ACK") if not items else self.link.recv_match(
                type=["MISSION_REQUEST_INT", "MISSION_ACK"], blocking=True, timeout=PATIENCE
            )  # fmt: skip
            assert m is not None
            if m.get_type() == "MISSION_ACK":
                return int(m.type)
            self.link.mav.send(items[m.seq])


def piloted(name: str = "bluerov2_hold") -> System:
    """Return a system whose pilot is moved by MAVLink."""
    swaps = {"pilot": "keyboard"}
    with_keyboards(lambda: load(name), swaps)
    system = load(name)
    for path, source in swaps.items():
        system = system.replace(path, source)
    return system


@contextmanager
def grounded(record: Path | None = None) -> Iterator[Ground]:
    """Run a vehicle at 5 times real time, with a ground station."""
    with (
        Conductor(piloted(), record=record) as conductor,
        MavlinkServer(conductor, "tcpin:127.0.0.1:0") as server,
    ):
        running = conductor.ask("run", ME, None, 5.0, ())
        station = Ground(conductor, server.ends[0].link.port)
        station.server = server
        yield station
        station.link.close()
        assert not running.done() or running.exception() is None
