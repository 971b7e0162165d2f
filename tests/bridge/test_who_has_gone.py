"""A run ends where it is when nobody waits for it any more, whatever door it was asked for at."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.desk import Client
from uuvsim_cosim.bridge.http_door import HttpDoor
from uuvsim_cosim.bridge.tcp_door import TcpDoor
from uuvsim_cosim.bridge.wire import frame
from uuvsim_cosim.bridge.zenoh_bridge import Bridge

sys.path.insert(0, str(Path(__file__).parent))

from doors import Peer

PARTS = Path(__file__).parent / "parts.py"
ME = Client("me", "local")
FOREVER = 1e9  # s


@pytest.fixture(scope="module")
def desk() -> Iterator[Conductor]:
    with Conductor(uuv.System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as desk:
        yield desk


def until(holds: Callable[[], bool], seconds: float = 10.0) -> None:
    """Wait for something to come true."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_run_ends_when_its_client_at_the_tcp_door_is_gone(desk: Conductor) -> None:
    with TcpDoor(desk, 0) as door:
        for call in ({"call": "run", "duration": FOREVER}, {"call": "step", "n": 10**9}):
            with Peer(door.port) as peer:
                peer.socket.sendall(frame(call))
                until(lambda: desk.moment().running)
            until(lambda: not desk.moment().running)
        assert desk.step(ME, 1)[0].tick == desk.moment().tick


def test_a_run_ends_when_its_client_at_the_http_door_is_gone(desk: Conductor) -> None:
    with HttpDoor(desk, 0) as door:
        asking = http.client.HTTPConnection("127.0.0.1", door.port)
        said = {"Content-Type": "application/json"}
        asking.request("POST", "/run", json.dumps({"duration": FOREVER}), said)
        until(lambda: desk.moment().running)
        asking.close()
        until(lambda: not desk.moment().running)


def test_a_run_ends_when_its_process_that_asked_by_zenoh_is_killed(desk: Conductor) -> None:
    with Bridge(desk, port=0) as bridge:
        script = f"import uuvsim_cosim as u; u.connect(port={bridge.port}).run(until={FOREVER})"
        with subprocess.Popen([sys.executable, "-c", script]) as process:
            until(lambda: desk.moment().running, 30.0)
            process.kill()
        until(lambda: not desk.moment().running)


def test_a_stream_without_an_end_goes_on_when_its_client_leaves(desk: Conductor) -> None:
    with TcpDoor(desk, 0) as door:
        with Peer(door.port) as peer:
            peer.ask({"call": "run", "factor": 50.0})
        before = desk.moment().tick
        until(lambda: desk.moment().tick > before + 20)
        assert desk.pause(ME).running is False


def test_an_answer_that_is_abandoned_ends_no_run_but_its_own(desk: Conductor) -> None:
    other = desk.ask("get", ME, ["sum.s"])
    running = desk.ask("run", ME, FOREVER, None, ())
    desk.abandon(other)
    until(lambda: desk.moment().running)
    assert not running.done()
    desk.abandon(running)
    assert list(running.result(10.0)) == ["time"]
