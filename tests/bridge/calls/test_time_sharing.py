"""Clients share the server's time: a rate of calls, and turns of those that read."""

from __future__ import annotations

import http.client
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.bridge.fake_service import FakeService
from tests.bridge.peer import Peer
from uuvsim_cosim.bridge.access.authentication import everybody
from uuvsim_cosim.bridge.calls.connection_limits import Limits
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.calls.time_sharing import RateLimit, Share
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
STEPS, READS = Client("steps", "local"), Client("reads", "local")


class Clock:
    """Seconds that pass when somebody sleeps."""

    def __init__(self) -> None:
        self.now = 100.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now += seconds


# ---- a rate of calls --------------------------------------------------------------------------


def test_calls_beyond_the_rate_wait_until_the_rate_is_kept() -> None:
    clock = Clock()
    pace = RateLimit(10.0, clock, clock.sleep)
    for _ in range(10):
        pace.wait()
    assert clock.slept == []
    for _ in range(20):
        pace.wait()
    assert sum(clock.slept) == pytest.approx(2.0)


def test_a_pause_gives_no_more_than_one_second_of_calls() -> None:
    clock = Clock()
    pace = RateLimit(10.0, clock, clock.sleep)
    clock.now += 3600.0
    for _ in range(11):
        pace.wait()
    assert sum(clock.slept) == pytest.approx(0.1)


class _Slept:
    """The module `time`, whose sleep is noted and takes no time."""

    def __init__(self) -> None:
        self.slept = 0.0

    def __getattr__(self, name: str) -> object:
        return getattr(time, name)

    def sleep(self, seconds: float) -> None:
        self.slept += seconds


@contextmanager
def _both(service: FakeService, limits: Limits) -> Iterator[tuple[TcpServer, HttpServer]]:
    with (
        TcpServer(service, 0, admit=everybody, limits=limits) as tcp,
        HttpServer(service, 0, admit=everybody, limits=limits) as web,
    ):
        yield tcp, web


@pytest.mark.parametrize("transport", ["tcp", "http"])
def test_each_connection_is_slowed_to_the_rate_of_calls(
    monkeypatch: pytest.MonkeyPatch, transport: str
) -> None:
    noted = _Slept()
    monkeypatch.setattr(RateLimit.__init__, "__defaults__", (time.monotonic, noted.sleep))
    limits = Limits(calls_per_s=0.001)  # one call, and the next after 1,000 s
    service = FakeService()
    with _both(service, limits) as (tcp, web):
        if transport == "tcp":
            with Peer(tcp.port) as peer:
                for _ in range(2):
                    peer.ask({"call": "describe"})
                slowed = noted.slept
                peer.ask({"call": "step"})  # who steps sets the pace
        else:
            link = http.client.HTTPConnection("127.0.0.1", web.port)
            for _ in range(2):
                link.request("GET", "/describe")
                assert link.getresponse().read()
            slowed = noted.slept
            link.close()
    assert slowed > 900.0
    assert transport == "http" or noted.slept == slowed


# ---- turns of those that read -----------------------------------------------------------------


def shared(clock: Clock, *, hurries: bool = False) -> Share:
    return Share(lambda: hurries, clock, clock, clock.sleep)


def read(share: Share, client: Client) -> None:
    share.wait(client, share.turn(client))


def test_nobody_waits_while_nobody_steps() -> None:
    clock = Clock()
    share = shared(clock)
    for _ in range(100):
        read(share, READS)
        share.took(READS, 1.0)
    assert clock.slept == []


def test_reading_beside_stepping_gets_its_share_of_the_time_however_many_read() -> None:
    for count in (1, 8):
        clock = Clock()
        share = shared(clock, hurries=True)
        begun, busy = clock.now, 0.0
        readers = [Client(f"reads {i}", "local") for i in range(count)]
        for _ in range(200):
            for reader in readers:
                read(share, reader)
                share.took(reader, 0.0005)
                share.also_took(reader, 0.0005)
                busy += 0.001
                clock.now += 0.001
        assert 0.02 < busy / (clock.now - begun) < 0.04


def test_turns_follow_the_processor_time_that_the_server_gets() -> None:
    clock = Clock()
    share = Share(lambda: True, clock, lambda: clock.now / 2, clock.sleep)  # half a processor
    begun = clock.now
    for _ in range(100):
        read(share, READS)
        share.took(READS, 0.001)
    assert 0.1 / (clock.now - begun) < 0.02


def test_turns_come_in_the_order_in_which_they_are_asked_for() -> None:
    share = shared(Clock(), hurries=True)
    turns = [share.turn(Client(f"reads {i}", "local")) for i in range(8)]
    assert None not in turns
    assert turns == sorted(turns)
    assert len(set(turns)) == 8


def test_a_client_that_steps_itself_does_not_wait_to_read() -> None:
    clock = Clock()
    share = shared(clock)
    share.steps(STEPS)
    share.steps(READS)
    assert [share.turn(READS) for _ in range(5)] == [None] * 5
    clock.now += 2.0
    share.steps(STEPS)
    assert share.turn(READS) is not None


def test_reading_waits_no_longer_once_stepping_has_ended() -> None:
    clock = Clock()
    share = shared(clock)
    share.steps(STEPS)
    for _ in range(1000):
        share.turn(READS)
    read(share, READS)
    assert 0.5 <= sum(clock.slept) < 0.6
    assert share.turn(READS) is None


def test_a_reading_call_waits_for_a_bounded_time() -> None:
    clock = Clock()
    share = shared(clock, hurries=True)
    share.took(READS, 3600.0)
    read(share, READS)
    assert sum(clock.slept) < 1.1


def test_constant_answers_are_built_once() -> None:
    with Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as service:
        schema = service.schema()
        assert service.schema() is schema
        assert service.schema().text is schema.text
        components = service.describe()["components"]
        assert service.describe()["components"] is components
        service.replace(STEPS, "sum", f"{PARTS}:Twice")
        assert [s.name for s in service.schema()] == ["sum.x", "sum.y"]
        assert service.describe()["components"][0]["name"] == "Twice"


@pytest.mark.parametrize("transport", ["tcp", "http", "zenoh"])
def test_a_client_that_reads_waits_its_turn_over_each_transport(
    monkeypatch: pytest.MonkeyPatch, transport: str
) -> None:
    asked: list[str] = []

    def turn(self: Share, client: Client) -> float:
        asked.append(client.name)
        return 0.0

    monkeypatch.setattr(Share, "turn", turn)
    with Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as service:
        if transport == "tcp":
            with TcpServer(service, 0, admit=everybody) as tcp, Peer(tcp.port) as peer:
                for call in ("describe", "schema", "get", "step", "snapshot"):
                    assert peer.ask({"call": call})[0]["ok"]
            assert asked == ["peer"] * 3
        elif transport == "http":
            with HttpServer(service, 0, admit=everybody) as web:
                link = http.client.HTTPConnection("127.0.0.1", web.port)
                for path in ("describe", "schema", "signals?names=sum.s"):
                    link.request("GET", f"/{path}")
                    assert link.getresponse().read().startswith(b'{"ok": true')
                link.request("POST", "/step")
                assert link.getresponse().read().startswith(b'{"ok": true')
                link.close()
            assert asked == ["http"] * 3
        else:
            from uuvsim_cosim.bridge.clients.client import connect

            with Bridge(service, port=0) as bridge, connect(port=bridge.port, name="z") as client:
                client.describe()
                assert client.signals
                assert client.get("sum.s") == 0.0
                client.step()
            assert asked == ["z"] * 3
