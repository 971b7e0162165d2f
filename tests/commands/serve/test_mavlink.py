"""Options of `uuvsim serve --mavlink`, and of `uuvsim run` with a followed vehicle."""

from __future__ import annotations

import json
import socket
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.bridge.mavlink import follower, server
from uuvsim_cosim.bridge.mavlink.codec import KEY
from uuvsim_cosim.bridge.mavlink.link import DEFAULT
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.commands.shared.common_options import with_implied_values

pytest.importorskip("pymavlink")
ANY = ["--port", "0", "--tcp-port", "-1", "--http-port", "-1", "--no-record"]
SERVED = ["serve", "bluerov2_hold", "--replace", "pilot=keyboard", "--until", "0.1", *ANY]
HOME = (47.39, 8.54)
PLACES = ((47.3901, 8.54, -3.0), (47.3901, 8.5401, -4.0))


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(KEY, raising=False)
    yield
    follower.allow(arm_real=False, unsigned=False)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[server.MavlinkServer]:
    """The servers that a command opens."""
    found: list[server.MavlinkServer] = []
    kind = server.MavlinkServer

    def opened(*arguments: Any, **named: Any) -> server.MavlinkServer:
        found.append(kind(*arguments, **named))
        return found[-1]

    monkeypatch.setattr(server, "MavlinkServer", opened)
    return found


def plan() -> str:
    """Write a plan of QGroundControl; return its name."""
    items = [
        {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, *place]}
        for place in PLACES
    ]
    mission = {"items": items, "plannedHomePosition": [*HOME, 0.0]}
    Path("mission.plan").write_text(json.dumps({"mission": mission}), encoding="utf-8")
    return "mission.plan"


@pytest.mark.parametrize(
    ("given", "filled"),
    [
        (["x", "--mavlink"], ["x", "--mavlink", DEFAULT]),
        (["--mavlink", "x"], ["--mavlink", DEFAULT, "x"]),
        (["x", "--mavlink", "--paused"], ["x", "--mavlink", DEFAULT, "--paused"]),
        (["x", "--mavlink", "tcp:h:1"], ["x", "--mavlink", "tcp:h:1"]),
        (["x", "--mavlink", "14550"], ["x", "--mavlink", "14550"]),
    ],
)
def test_mavlink_without_an_address_has_the_default_one(
    given: list[str], filled: list[str]
) -> None:
    assert with_implied_values(given) == filled


def test_mavlink_alone_serves_at_the_default_address(
    made: list[server.MavlinkServer], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of([*SERVED, "--mavlink"]) == 0
    assert f"MAVLink {DEFAULT}" in capsys.readouterr().out
    assert made[0].addresses == (DEFAULT,)


def test_a_plan_is_the_mission_of_the_vehicle(
    made: list[server.MavlinkServer], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of([*SERVED, "--mavlink", "tcpin:127.0.0.1:0", "--waypoints", plan()]) == 0
    assert "its north is true north" in capsys.readouterr().out
    services = made[0].ends[0].services
    assert services.origin == HOME
    items = [(i.command, i.x, i.y, i.z) for i in services.missions.items]
    assert items[0] == (16, round(HOME[0] * 1e7), round(HOME[1] * 1e7), 0.0)
    for item, (lat, lon, z) in zip(items[1:], PLACES, strict=True):
        assert item == (16, pytest.approx(lat * 1e7, abs=2), pytest.approx(lon * 1e7, abs=2), z)


def test_waypoints_need_a_guidance_or_mavlink(capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of([*SERVED, "--waypoints", plan()]) == 2
    assert "0 components have a parameter 'waypoints'" in capsys.readouterr().err
    guided = ["serve", "bluerov2_survey", "--until", "0.1", *ANY, "--waypoints", plan()]
    assert status_of(guided) == 0
    assert status_of([*SERVED, "--origin", "1,2"]) == 2
    assert (
        "expected --waypoints, --mavlink, --ros2 or --foxglove as well" in capsys.readouterr().err
    )


def test_a_run_sends_commands_only_with_arm_real_and_prints_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as vehicle:
        at = f"mavlink:tcp:127.0.0.1:{vehicle.getsockname()[1]}"
        monkeypatch.setattr(follower, "_WAIT", 0.0)  # it sends nothing
        run = ["run", "bluerov2_hold", "--replace", f"hull={at}", "--until", "0.05",
               "--native", "--no-report", "-o", "out"]  # fmt: skip
        assert status_of(run) == 2
        assert "expected --real-time 1 as well" in capsys.readouterr().err
        run += ["--real-time", "1"]
        assert status_of([*run, "--arm-real"]) == 2
        assert f"{KEY} names no file with a pass phrase" in capsys.readouterr().err
        assert status_of([*run, "--unsigned"]) == 2
        assert "expected --arm-real as well" in capsys.readouterr().err
        assert status_of(run) == 0
        assert "commands" not in capsys.readouterr().err
        assert not follower._permitted["commands"]
        assert status_of([*run, "--arm-real", "--unsigned"]) == 0
        printed = capsys.readouterr().err
        assert "--arm-real: commands are sent to a followed vehicle" in printed
        assert "--unsigned: these commands are not signed" in printed
        assert follower._permitted["commands"]
