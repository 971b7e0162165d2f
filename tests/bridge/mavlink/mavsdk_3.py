"""Script: a vehicle over MAVLink, asked by MAVSDK 3 and its `mavsdk_server`; it prints results.

MAVSDK 3 cannot be in the environment of MAVSDK 4. Install it into a folder, then run this script:

    pip install --target FOLDER mavsdk==3.17.4
    python -m tests.bridge.mavlink.mavsdk_3 FOLDER
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

LIMIT = 60.0  # [s] of one check
_DO_SET_MODE, _MISSION_START = 176, 300
_ORIGIN, _PLACES = (33.810313, -118.393867), ((2.0, 0.0, 3.0), (2.0, 2.0, 3.0))  # deg; N E D [m]


def serve(folder: str) -> int:
    """Serve the vehicle, and run the client with the packages of the folder."""
    from tests.bridge.mavlink.ground import ME, piloted
    from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
    from uuvsim_cosim.bridge.mavlink.vehicle import global_of
    from uuvsim_cosim.bridge.server.conductor import Conductor

    places = [global_of(n, e, _ORIGIN) for n, e, _ in ((0.0, 0.0, 0.0), *_PLACES)]
    with (
        Conductor(piloted()) as conductor,
        MavlinkServer(conductor, "tcpin:127.0.0.1:0") as server,
    ):
        conductor.ask("run", ME, None, 5.0, ())
        port = server.ends[0].link.port
        done = subprocess.run(
            [sys.executable, __file__, "client", str(port), json.dumps(places)],
            env={**os.environ, "PYTHONPATH": folder},
            check=False,
        )
        return done.returncode


async def first(stream: Any, good: Callable[[Any], bool]) -> Any:
    """Return the first value of a stream that fits."""
    async for value in stream:
        if good(value):
            return value
    raise AssertionError("the stream has ended")


class Checks:
    """The checks; each is a coroutine without arguments."""

    def __init__(self, system: Any, places: list[tuple[float, float]]) -> None:
        self.s, self.places = system, places

    async def place(self, good: Callable[..., bool]) -> Any:
        """Wait until the vehicle is at a place that fits."""

        def fits(both: Any) -> bool:
            p = both.position
            return good(p.north_m, p.east_m, p.down_m)

        return await first(self.s.telemetry.position_velocity_ned(), fits)

    async def command(self, number: int, *values: float) -> None:
        """Send a command as a message; its effect is awaited by the caller."""
        from mavsdk.mavlink_direct import MavlinkMessage

        fields = {f"param{i}": v for i, v in enumerate((*values, *[0.0] * 7)[:7], start=1)}
        fields |= {"target_system": 1, "target_component": 1, "command": number, "confirmation": 0}
        message = MavlinkMessage("COMMAND_LONG", 245, 190, 1, 1, json.dumps(fields))
        await self.s.mavlink_direct.send_message(message)

    async def arm(self, mode: int) -> None:
        """Set a mode, and arm."""
        await self.command(_DO_SET_MODE, 1, mode)
        await self.s.action.arm()
        await first(self.s.telemetry.armed(), bool)

    async def telemetry(self) -> None:
        """Receive place and attitude."""
        await self.place(lambda n, e, d: abs(d - 1.0) < 0.1)
        await first(self.s.telemetry.attitude_euler(), lambda a: abs(a.roll_deg) < 5.0)

    async def arming(self) -> None:
        """Arm and disarm."""
        await self.s.action.arm()
        await first(self.s.telemetry.armed(), lambda armed: armed)
        await self.s.action.disarm()
        await first(self.s.telemetry.armed(), lambda armed: not armed)

    async def parameters(self) -> None:
        """Set and read a parameter, and list all."""
        await self.s.param.set_param_float("HULL_M", 12.0)
        assert await self.s.param.get_param_float("HULL_M") == 12.0
        assert len((await self.s.param.get_all_params()).float_params) > 10

    async def set_points(self) -> None:
        """Reach a local set-point."""
        from mavsdk.offboard import PositionNedYaw

        await self.arm(4)
        await self.s.offboard.set_position_ned(PositionNedYaw(1.0, 1.0, 3.0, 0.0))
        await self.place(lambda *at: math.dist(at, (1.0, 1.0, 3.0)) < 0.1)

    async def manual_control(self) -> None:
        """Go ahead by manual control."""
        await self.arm(19)
        start = (await self.place(lambda *at: True)).position.north_m
        async for both in self.s.telemetry.position_velocity_ned():
            await self.s.manual_control.set_manual_control_input(1.0, 0.0, 0.5, 0.0)
            if both.position.north_m > start + 0.5:
                return

    async def mission(self) -> None:
        """Upload, download and fly a mission."""
        from mavsdk.mission_raw import MissionItem

        depths = (0.0, *(d for _, _, d in _PLACES))
        items = [
            MissionItem(seq, 3, 16, int(seq == 0), 1, 0.0, 0.0, 0.0, 0.0, round(lat * 1e7),
                        round(lon * 1e7), -d, 0)
            for seq, ((lat, lon), d) in enumerate(zip(self.places, depths, strict=True))
        ]  # fmt: skip
        await self.s.mission_raw.upload_mission(items)
        down = await self.s.mission_raw.download_mission()
        assert [(i.x, i.y, i.z) for i in down] == [(i.x, i.y, i.z) for i in items]
        await self.command(_MISSION_START)
        await self.place(lambda *at: math.dist(at, _PLACES[-1]) < 1.0)

    async def log(self) -> None:
        """Download a log."""
        await self.s.action.disarm()
        entry = (await self.s.log_files.get_entries())[-1]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "1.BIN"
            async for _ in self.s.log_files.download_log_file(entry, str(path)):
                pass
            assert path.stat().st_size == entry.size_bytes


async def ask(port: str, places: list[tuple[float, float]]) -> int:
    """Make all checks; return 1 if one has failed."""
    from mavsdk import System

    system = System()
    await system.connect(system_address=f"tcpout://127.0.0.1:{port}")
    await first(system.core.connection_state(), lambda state: state.is_connected)
    checks, failed = Checks(system, places), 0
    for name in ("telemetry", "arming", "parameters", "set_points", "manual_control", "mission",
                 "log"):  # fmt: skip
        try:
            await asyncio.wait_for(getattr(checks, name)(), LIMIT)
            print(f"{name}: passed", flush=True)
        except Exception as error:
            failed = 1
            print(f"{name}: failed, {type(error).__name__}: {error}", flush=True)
    return failed


if __name__ == "__main__":
    if sys.argv[1] == "client":
        sys.exit(asyncio.run(ask(sys.argv[2], json.loads(sys.argv[3]))))
    sys.exit(serve(sys.argv[1]))
