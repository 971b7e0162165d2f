"""Malformed, oversized, slow, flooding and half-open clients: the co-simulation steps meanwhile."""

from __future__ import annotations

import contextlib
import http.client
import os
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.bridge.client import connect
from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.desk import Client
from uuvsim_cosim.bridge.http_door import HttpDoor
from uuvsim_cosim.bridge.tcp_door import TcpDoor
from uuvsim_cosim.bridge.wire import Limits, frame
from uuvsim_cosim.bridge.wrapped_session import connecting
from uuvsim_cosim.bridge.zenoh_bridge import Bridge
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system import System

sys.path.insert(0, str(Path(__file__).parent))

from doors import Peer

PARTS = Path(__file__).parent / "parts.py"
ME = Client("me", "local")
FEW = Limits(clients=3, patience_s=0.0)


@dataclass
class Doors:
    conductor: Conductor
    zenoh: Bridge
    tcp: TcpDoor
    http: HttpDoor

    @property
    def ports(self) -> dict[str, int]:
        return {"zenoh": self.zenoh.port, "tcp": self.tcp.port, "http": self.http.port}


def sums() -> System:
    return System("sums", "0.1").add("sum", f"{PARTS}:Sum")


@pytest.fixture(scope="module")
def doors() -> Iterator[Doors]:
    with (
        Conductor(sums()) as conductor,
        Bridge(conductor, port=0) as bridge,
        TcpDoor(conductor, 0) as tcp,
        HttpDoor(conductor, 0) as http,
    ):
        yield Doors(conductor, bridge, tcp, http)


def serves(doors: Doors) -> None:
    """Assert that steps are made, for one who asks here and at each door."""
    before = doors.conductor.moment().tick
    doors.conductor.step(ME, 5)
    with connect(port=doors.zenoh.port) as client:
        client.step(5)
    with Peer(doors.tcp.port) as peer:
        assert peer.ask({"call": "step", "n": 5})[0]["ok"]
    connection = http.client.HTTPConnection("127.0.0.1", doors.http.port, timeout=20.0)
    connection.request("POST", "/step", b'{"n": 5}', {"Content-Type": "application/json"})
    assert connection.getresponse().status == 200
    connection.close()
    assert doors.conductor.moment().tick == before + 20


# ---- what is no request -----------------------------------------------------------------------


@pytest.mark.parametrize("door", ["zenoh", "tcp", "http"])
@pytest.mark.parametrize(
    "data",
    [b"", b"\x00", b"\xff" * 70_000, b"\xff\xff\x01" + bytes(40), b"GET / HTTP/1.1\r\n", b"{" * 99],
    ids=["nothing", "a byte", "ones", "a long frame", "half a request", "braces"],
)
def test_half_open_and_malformed_connections_hold_nobody_up(
    doors: Doors, door: str, data: bytes
) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(8):
            one = socket.create_connection(("127.0.0.1", doors.ports[door]), timeout=20.0)
            stack.enter_context(one)
            with contextlib.suppress(OSError):
                one.sendall(data)
        serves(doors)


def test_random_bytes_at_every_door_stop_nothing(doors: Doors) -> None:
    for port in doors.ports.values():
        for size in (3, 300, 30_000):
            one = socket.create_connection(("127.0.0.1", port), timeout=20.0)
            with one, contextlib.suppress(OSError):
                one.sendall(os.urandom(size))
    serves(doors)


def test_an_oversized_message_at_zenoh_is_refused_in_words(doors: Doors) -> None:
    with connecting("127.0.0.1", doors.zenoh.port) as session:
        for said, block, words in (
            (b'{"names": [' + b'"x",' * 500_000, b"", "a message of 2000011 bytes; expected at"),
            (
                b"{}",
                bytes(9 << 20),
                "a block of numbers of 9437184 bytes; expected at most 8388608",
            ),
        ):
            asker = session.asker("uuvsim/sums/call/get")
            reply = next(iter(asker.get(payload=said, attachment=block or None)))
            assert words in reply.err.payload.to_string()
    serves(doors)


# ---- floods -----------------------------------------------------------------------------------


def flood_zenoh(doors: Doors, begun: threading.Event, over: threading.Event) -> None:
    answered = [0]

    def count(reply: Any) -> None:
        answered[0] += 1

    with connecting("127.0.0.1", doors.zenoh.port) as session:
        while not over.is_set():
            for _ in range(100):
                session.raw.get("uuvsim/sums/call/get", count, payload='{"names": ["sum.s"]}')
            list(session.raw.get("uuvsim/sums/call/describe", timeout=20.0))
            begun.set()
    assert answered[0] > 0


def flood_tcp(doors: Doors, begun: threading.Event, over: threading.Event) -> None:
    asked = frame({"call": "get", "names": ["sum.s"]}) * 50
    with Peer(doors.tcp.port) as peer:
        while not over.is_set():
            peer.socket.sendall(asked)
            for _ in range(50):
                peer.answer()
            begun.set()


def flood_http(doors: Doors, begun: threading.Event, over: threading.Event) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", doors.http.port, timeout=20.0)
    while not over.is_set():
        connection.request("GET", "/signals?names=sum.s")
        connection.getresponse().read()
        begun.set()
    connection.close()


def flood_connections(doors: Doors, begun: threading.Event, over: threading.Event) -> None:
    while not over.is_set():
        for port in doors.ports.values():
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", port), timeout=20.0).close()
        begun.set()


@pytest.mark.parametrize("flood", [flood_zenoh, flood_tcp, flood_http, flood_connections])
def test_a_run_reaches_its_end_in_a_flood(
    doors: Doors, flood: Callable[[Doors, threading.Event, threading.Event], None]
) -> None:
    begun, over = threading.Event(), threading.Event()
    thread = threading.Thread(target=flood, args=(doors, begun, over))
    doors.conductor.reset(ME)
    thread.start()
    try:
        assert begun.wait(60.0)
        recorded = doors.conductor.run(ME, 200.0, None, ["sum.s"])
    finally:
        over.set()
        thread.join()
    assert len(recorded["time"]) == 2001
    serves(doors)


def test_calls_that_never_cease_do_not_keep_a_run_from_its_end(doors: Doors) -> None:
    over = threading.Event()
    doors.conductor.reset(ME)

    def again(_: object) -> None:
        if not over.is_set():
            doors.conductor.ask("get", ME, ["sum.s"]).add_done_callback(again)

    for _ in range(50):
        again(None)
    running = doors.conductor.ask("run", ME, 100.0, None, ())
    try:
        running.result(timeout=60.0)
    finally:
        over.set()
    assert doors.conductor.moment().tick == 1000


# ---- clients that do not take their answers ----------------------------------------------------


class _Stuck:
    """A query of a client that takes nothing off its line."""

    key_expr = "uuvsim/sums/call/describe"
    payload = attachment = None

    def __init__(self, free: threading.Event, told: list[str]) -> None:
        self._free, self._told = free, told

    def reply(self, *_: object, **__: object) -> None:
        self._free.wait()
        self._told.append("answer")

    def reply_err(self, said: str) -> None:
        self._told.append(said)

    def drop(self) -> None:
        self._told.append("end")


def test_an_answer_that_nobody_takes_holds_only_its_client_up() -> None:
    free, told = threading.Event(), []
    with Bridge(sums(), port=0) as bridge, connect(port=bridge.port) as client:
        for _ in range(200):
            bridge._asked(_Stuck(free, told))
        assert bridge.conductor.step(ME, 3)[0].tick == 3
        assert client.step(2) == {}
        assert bridge.conductor.moment().tick == 5
        assert "answer" not in told  # it waits still
        assert told.count("end") >= 72  # of 200: beyond 64 that wait and 64 that are told
        free.set()
        with connect(port=bridge.port) as another:
            another.step(1)
    assert told.count("answer") <= 64


# ---- places that are taken --------------------------------------------------------------------


@pytest.mark.parametrize("door", ["tcp", "http"])
def test_who_says_nothing_gives_his_place_to_who_does(doors: Doors, door: str) -> None:
    with contextlib.ExitStack() as stack:
        tcp = stack.enter_context(TcpDoor(doors.conductor, 0, limits=FEW))
        http_ = stack.enter_context(HttpDoor(doors.conductor, 0, limits=FEW))
        port = tcp.port if door == "tcp" else http_.port
        silent = [socket.create_connection(("127.0.0.1", port), 20.0) for _ in range(9)]
        for one in silent:
            stack.enter_context(one)
        if door == "tcp":
            with Peer(port) as peer:
                assert peer.ask({"call": "step"})[0]["ok"]
        else:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)
            connection.request("GET", "/signals?names=sum.s")
            assert connection.getresponse().status == 200
            connection.close()
        with contextlib.suppress(ConnectionError):
            while silent[0].recv(1 << 16):
                pass  # its greeting; then it is let go


# ---- death in lockstep ------------------------------------------------------------------------


def in_lockstep(port: int, name: str) -> Peer:
    peer = Peer(port, name=name, lockstep=True, lag=3600)
    assert peer.welcome["ok"], peer.welcome
    return peer


def asked(conductor: Conductor, peer: Peer) -> None:
    """Ask for a step, and wait until it waits for the others."""
    peer.socket.sendall(frame({"call": "step"}))
    while not conductor._lockstep.barrier.asked():
        conductor.describe()


def test_a_lockstep_client_that_dies_at_the_tcp_door_is_dropped_at_once() -> None:
    with (
        Conductor(sums()) as conductor,
        TcpDoor(conductor, 0) as door,
        in_lockstep(door.port, "lives") as lives,
        in_lockstep(door.port, "dies") as dies,
    ):
        asked(conductor, lives)
        dies.socket.close()
        assert lives.answer()[0]["tick"] == 1
        assert lives.ask({"call": "step"})[0]["tick"] == 2


def test_a_lockstep_client_that_dies_at_the_tcp_door_pauses_where_that_is_wanted() -> None:
    with (
        Conductor(sums(), fail_safe="pause") as conductor,
        TcpDoor(conductor, 0) as door,
        in_lockstep(door.port, "lives") as lives,
        in_lockstep(door.port, "dies") as dies,
    ):
        asked(conductor, lives)
        dies.socket.close()
        told = lives.answer()[0]
        assert "client 'dies' is gone, and the co-simulation pauses" in told["error"]
        assert conductor.moment().tick == 0


def test_a_client_that_says_bye_has_not_died() -> None:
    with (
        Conductor(sums(), fail_safe="pause") as conductor,
        TcpDoor(conductor, 0) as door,
        in_lockstep(door.port, "stays") as stays,
        in_lockstep(door.port, "goes") as goes,
    ):
        asked(conductor, stays)
        goes.ask({"call": "bye"})
        assert stays.answer()[0]["tick"] == 1


def test_a_lag_that_is_no_time_is_refused_at_zenoh(doors: Doors) -> None:
    with pytest.raises(InputInvalid, match="lag"):
        connect(port=doors.zenoh.port, lockstep=True, lag=float("nan"))
