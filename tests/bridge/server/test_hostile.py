"""Malformed, oversized, slow, flooding and half-open clients: the co-simulation steps meanwhile."""

from __future__ import annotations

import contextlib
import http.client
import os
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.peer import Peer, bearer
from tests.bridge.waiting import PATIENCE, until
from uuvsim_cosim.bridge.access.token import known_token
from uuvsim_cosim.bridge.access.zenoh_permissions import GUEST, client_settings
from uuvsim_cosim.bridge.calls.connection_limits import Limits
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.framing import frame
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.zenoh.session import Disconnected, WrappedSession, connecting
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")
FEW = Limits(clients=3, unauthenticated=3)


@dataclass
class Endpoints:
    conductor: Conductor
    zenoh: Bridge
    tcp: TcpServer
    http: HttpServer

    @property
    def ports(self) -> dict[str, int]:
        return {"zenoh": self.zenoh.port, "tcp": self.tcp.port, "http": self.http.port}


def sums() -> System:
    return System("sums", "0.1").add("sum", f"{PARTS}:Sum")


@pytest.fixture(scope="module")
def endpoints() -> Iterator[Endpoints]:
    with (
        Conductor(sums()) as conductor,
        Bridge(conductor, port=0) as bridge,
        TcpServer(conductor, 0) as tcp,
        HttpServer(conductor, 0) as http,
    ):
        yield Endpoints(conductor, bridge, tcp, http)


def session_at(port: int) -> WrappedSession:
    """Open a session of Zenoh, as one who has the token."""
    token = known_token("127.0.0.1", port)
    return connecting("127.0.0.1", port, client_settings(GUEST, token))


def serves(endpoints: Endpoints) -> None:
    """Assert that steps are made, for one who asks here and at each endpoint."""
    before = endpoints.conductor.moment().tick
    endpoints.conductor.step(ME, 5)
    with connect(port=endpoints.zenoh.port) as client:
        client.step(5)
    with Peer(endpoints.tcp.port) as peer:
        assert peer.ask({"call": "step", "n": 5})[0]["ok"]
    connection = http.client.HTTPConnection("127.0.0.1", endpoints.http.port)
    headers = {"Content-Type": "application/json", **bearer(endpoints.http.port)}
    connection.request("POST", "/step", b'{"n": 5}', headers)
    assert connection.getresponse().status == 200
    connection.close()
    assert endpoints.conductor.moment().tick == before + 20


# ---- what is no request -----------------------------------------------------------------------


@pytest.mark.parametrize("endpoint", ["zenoh", "tcp", "http"])
@pytest.mark.parametrize(
    "data",
    [b"", b"\x00", b"\xff" * 70_000, b"\xff\xff\x01" + bytes(40), b"GET / HTTP/1.1\r\n", b"{" * 99],
    ids=["nothing", "a byte", "ones", "a long frame", "half a request", "braces"],
)
def test_half_open_and_malformed_connections_hold_nobody_up(
    endpoints: Endpoints, endpoint: str, data: bytes
) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(8):
            one = socket.create_connection(("127.0.0.1", endpoints.ports[endpoint]))
            stack.enter_context(one)
            with contextlib.suppress(OSError):
                one.sendall(data)
        serves(endpoints)


def test_random_bytes_at_every_endpoint_stop_nothing(endpoints: Endpoints) -> None:
    for port in endpoints.ports.values():
        for size in (3, 300, 30_000):
            one = socket.create_connection(("127.0.0.1", port))
            with one, contextlib.suppress(OSError):
                one.sendall(os.urandom(size))
    serves(endpoints)


def test_an_oversized_message_at_zenoh_is_refused_in_words(endpoints: Endpoints) -> None:
    with session_at(endpoints.zenoh.port) as session:
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
    serves(endpoints)


# ---- floods -----------------------------------------------------------------------------------


def flood_zenoh(endpoints: Endpoints, begun: threading.Event, over: threading.Event) -> None:
    answered = [0]

    def count(reply: Any) -> None:
        answered[0] += 1

    with session_at(endpoints.zenoh.port) as session:
        while not over.is_set():
            for _ in range(100):
                session.raw.get("uuvsim/sums/call/get", count, payload='{"names": ["sum.s"]}')
            list(session.raw.get("uuvsim/sums/call/describe", timeout=PATIENCE))
            begun.set()
    assert answered[0] > 0


def flood_tcp(endpoints: Endpoints, begun: threading.Event, over: threading.Event) -> None:
    asked = frame({"call": "get", "names": ["sum.s"]}) * 50
    with Peer(endpoints.tcp.port) as peer:
        while not over.is_set():
            peer.socket.sendall(asked)
            for _ in range(50):
                peer.answer()
            begun.set()


def flood_http(endpoints: Endpoints, begun: threading.Event, over: threading.Event) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", endpoints.http.port)
    while not over.is_set():
        connection.request("GET", "/signals?names=sum.s", headers=bearer(endpoints.http.port))
        connection.getresponse().read()
        begun.set()
    connection.close()


def flood_connections(endpoints: Endpoints, begun: threading.Event, over: threading.Event) -> None:
    while not over.is_set():
        for port in endpoints.ports.values():
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", port)).close()
        begun.set()


@pytest.mark.parametrize("flood", [flood_zenoh, flood_tcp, flood_http, flood_connections])
def test_a_run_reaches_its_end_in_a_flood(
    endpoints: Endpoints, flood: Callable[[Endpoints, threading.Event, threading.Event], None]
) -> None:
    begun, over = threading.Event(), threading.Event()
    thread = threading.Thread(target=flood, args=(endpoints, begun, over))
    endpoints.conductor.reset(ME)
    thread.start()
    try:
        assert begun.wait(PATIENCE)
        recorded = endpoints.conductor.run(ME, 200.0, None, ["sum.s"])
    finally:
        over.set()
        thread.join()
    assert len(recorded["time"]) == 2001
    serves(endpoints)


def test_calls_that_never_cease_do_not_keep_a_run_from_its_end(endpoints: Endpoints) -> None:
    over = threading.Event()
    endpoints.conductor.reset(ME)

    def again(_: object) -> None:
        if not over.is_set():
            endpoints.conductor.ask("get", ME, ["sum.s"]).add_done_callback(again)

    for _ in range(50):
        again(None)
    running = endpoints.conductor.ask("run", ME, 100.0, None, ())
    try:
        running.result()
    finally:
        over.set()
    assert endpoints.conductor.moment().tick == 1000


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

    def reply_err(self, said: str, **_: object) -> None:
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
        # Of 200, 64 wait for an answer, and at most 64 wait to be refused; the others have ended.
        until(lambda: told.count("end") >= 72)
        free.set()
        with connect(port=bridge.port) as another:
            another.step(1)
    assert told.count("answer") <= 64


# ---- places that are taken --------------------------------------------------------------------


@pytest.mark.parametrize("endpoint", ["tcp", "http"])
def test_who_says_nothing_gives_his_place_to_who_does(endpoints: Endpoints, endpoint: str) -> None:
    with contextlib.ExitStack() as stack:
        tcp = stack.enter_context(TcpServer(endpoints.conductor, 0, limits=FEW))
        http_ = stack.enter_context(HttpServer(endpoints.conductor, 0, limits=FEW))
        port = tcp.port if endpoint == "tcp" else http_.port
        silent = [socket.create_connection(("127.0.0.1", port), PATIENCE) for _ in range(9)]
        for one in silent:
            stack.enter_context(one)
        if endpoint == "tcp":
            with Peer(port) as peer:
                assert peer.ask({"call": "step"})[0]["ok"]
        else:
            connection = http.client.HTTPConnection("127.0.0.1", port)
            connection.request("GET", "/signals?names=sum.s", headers=bearer(port))
            assert connection.getresponse().status == 200
            connection.close()
        with contextlib.suppress(ConnectionError):
            while silent[0].recv(1 << 16):
                pass  # its greeting; then it is let go


def held_silent(stack: contextlib.ExitStack, port: int, count: int) -> None:
    for _ in range(count):
        stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE))


def test_silent_connections_over_http_keep_no_client_out(endpoints: Endpoints) -> None:
    with contextlib.ExitStack() as stack:
        endpoint = stack.enter_context(HttpServer(endpoints.conductor, 0))
        held_silent(stack, endpoint.port, 300)
        for _ in range(20):
            connection = http.client.HTTPConnection("127.0.0.1", endpoint.port)
            stack.callback(connection.close)
            connection.request("GET", "/signals?names=sum.s", headers=bearer(endpoint.port))
            assert connection.getresponse().status == 200


def test_silent_connections_at_tcp_keep_no_client_out(endpoints: Endpoints) -> None:
    with contextlib.ExitStack() as stack:
        endpoint = stack.enter_context(TcpServer(endpoints.conductor, 0))
        held_silent(stack, endpoint.port, 300)
        for _ in range(20):
            peer = stack.enter_context(Peer(endpoint.port))
            assert peer.ask({"call": "step"})[0]["ok"]


@pytest.mark.parametrize("endpoint", ["tcp", "http"])
def test_who_may_not_enter_takes_no_place_of_a_client(endpoints: Endpoints, endpoint: str) -> None:
    with contextlib.ExitStack() as stack:
        tcp = stack.enter_context(TcpServer(endpoints.conductor, 0, limits=FEW))
        http_ = stack.enter_context(HttpServer(endpoints.conductor, 0, limits=FEW))
        for _ in range(9):
            if endpoint == "tcp":
                assert not stack.enter_context(Peer(tcp.port, token="x" * 43)).welcome["ok"]
            else:
                link = http.client.HTTPConnection("127.0.0.1", http_.port)
                stack.callback(link.close)
                link.request("GET", "/describe", headers={"Authorization": "Bearer " + "x" * 43})
                assert link.getresponse().status == 401
        peers = [stack.enter_context(Peer(tcp.port)) for _ in range(3)]
        assert all(peer.welcome["ok"] for peer in peers)
        link = http.client.HTTPConnection("127.0.0.1", http_.port)
        stack.callback(link.close)
        link.request("GET", "/describe", headers=bearer(http_.port))
        assert link.getresponse().status == 200


def test_silent_connections_at_zenoh_keep_no_client_out(endpoints: Endpoints) -> None:
    with contextlib.ExitStack() as stack:
        held_silent(stack, endpoints.zenoh.port, 300)  # more than Zenoh lets wait by default
        for _ in range(5):
            with connect(port=endpoints.zenoh.port) as client:
                client.step(1)


def test_a_port_that_opens_no_session_is_told_from_one_where_nobody_is() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        closing = threading.Thread(target=lambda: [silent.accept()[0].close() for _ in range(3)])
        closing.start()
        with pytest.raises(Disconnected, match=rf"port {port}, accepts connections, but opens no"):
            connecting("127.0.0.1", port)
        for _ in range(3):
            with contextlib.suppress(OSError):
                socket.create_connection(("127.0.0.1", port), 1.0).close()
        closing.join()


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


def test_a_lockstep_client_that_dies_at_the_tcp_endpoint_is_dropped_at_once() -> None:
    with (
        Conductor(sums()) as conductor,
        TcpServer(conductor, 0) as endpoint,
        in_lockstep(endpoint.port, "lives") as lives,
        in_lockstep(endpoint.port, "dies") as dies,
    ):
        asked(conductor, lives)
        dies.socket.close()
        assert lives.answer()[0]["tick"] == 1
        assert lives.ask({"call": "step"})[0]["tick"] == 2


def test_a_lockstep_client_that_dies_at_the_tcp_endpoint_pauses_where_that_is_wanted() -> None:
    with (
        Conductor(sums(), fail_safe="pause") as conductor,
        TcpServer(conductor, 0) as endpoint,
        in_lockstep(endpoint.port, "lives") as lives,
        in_lockstep(endpoint.port, "dies") as dies,
    ):
        asked(conductor, lives)
        dies.socket.close()
        told = lives.answer()[0]
        assert "client 'dies' has disconnected, and the co-simulation is paused" in told["error"]
        assert conductor.moment().tick == 0


def test_a_client_that_says_bye_has_not_died() -> None:
    with (
        Conductor(sums(), fail_safe="pause") as conductor,
        TcpServer(conductor, 0) as endpoint,
        in_lockstep(endpoint.port, "stays") as stays,
        in_lockstep(endpoint.port, "goes") as goes,
    ):
        asked(conductor, stays)
        goes.ask({"call": "bye"})
        assert stays.answer()[0]["tick"] == 1


def test_a_lag_that_is_no_time_is_refused_at_zenoh(endpoints: Endpoints) -> None:
    with pytest.raises(InputInvalid, match="lag"):
        connect(port=endpoints.zenoh.port, lockstep=True, lag=float("nan"))
