"""A run ends where it is when nobody waits for it any more, over any transport."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.bridge.peer import Peer, bearer
from tests.bridge.waiting import PATIENCE, until
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.framing import frame
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")
FOREVER = 1e9  # s


@pytest.fixture(scope="module")
def service() -> Iterator[Conductor]:
    with Conductor(uuv.System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as service:
        yield service


def test_a_run_ends_when_its_client_at_the_tcp_endpoint_is_gone(service: Conductor) -> None:
    with TcpServer(service, 0) as endpoint:
        for call in ({"call": "run", "duration": FOREVER}, {"call": "step", "n": 10**9}):
            with Peer(endpoint.port) as peer:
                peer.socket.sendall(frame(call))
                until(lambda: service.moment().running)
            until(lambda: not service.moment().running)
        assert service.step(ME, 1)[0].tick == service.moment().tick


def test_a_run_ends_when_its_client_at_the_http_endpoint_is_gone(service: Conductor) -> None:
    with HttpServer(service, 0) as endpoint:
        asking = http.client.HTTPConnection("127.0.0.1", endpoint.port)
        said = {"Content-Type": "application/json", **bearer(endpoint.port)}
        asking.request("POST", "/run", json.dumps({"duration": FOREVER}), said)
        until(lambda: service.moment().running)
        asking.close()
        until(lambda: not service.moment().running)


def test_a_run_ends_when_its_process_that_asked_by_zenoh_is_killed(service: Conductor) -> None:
    with Bridge(service, port=0) as bridge:
        script = f"import uuvsim_cosim as u; u.connect(port={bridge.port}).run(until={FOREVER})"
        with subprocess.Popen([sys.executable, "-c", script]) as process:
            until(lambda: service.moment().running)
            process.kill()
        until(lambda: not service.moment().running)


def test_a_stream_without_an_end_goes_on_when_its_client_leaves(service: Conductor) -> None:
    with TcpServer(service, 0) as endpoint:
        with Peer(endpoint.port) as peer:
            peer.ask({"call": "run", "factor": 50.0})
        before = service.moment().tick
        until(lambda: service.moment().tick > before + 20)
        assert service.pause(ME).running is False


def test_an_answer_that_is_abandoned_ends_no_run_but_its_own(service: Conductor) -> None:
    other = service.ask("get", ME, ["sum.s"])
    running = service.ask("run", ME, FOREVER, None, ())
    service.abandon(other)
    until(lambda: service.moment().running)
    assert not running.done()
    service.abandon(running)
    assert list(running.result(PATIENCE)) == ["time"]
