"""Roles hold at every endpoint alike, and who is refused is told why in words."""

from __future__ import annotations

import base64
import http.client
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.bridge import guarded
from tests.bridge.guarded import PASSWORDS, access_file
from tests.bridge.peer import Peer
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.access.access_file import read_access
from uuvsim_cosim.bridge.access.authentication import Authenticator
from uuvsim_cosim.bridge.access.roles import NEEDS, ROLES
from uuvsim_cosim.bridge.access.zenoh_permissions import GUEST, READER, client_settings
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.zenoh.session import Disconnected, connecting
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")


@dataclass
class Endpoints:
    conductor: Conductor
    zenoh: Bridge
    tcp: TcpServer
    http: HttpServer


def endpoints_of(file: Path) -> Iterator[Endpoints]:
    authenticator = Authenticator(read_access(file))
    with (
        Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as conductor,
        Bridge(conductor, port=0, access=authenticator) as bridge,
        TcpServer(conductor, 0, admit=authenticator) as tcp,
        HttpServer(conductor, 0, admit=authenticator) as http,
    ):
        yield Endpoints(conductor, bridge, tcp, http)


@pytest.fixture(scope="module")
def endpoints(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Endpoints]:
    yield from endpoints_of(access_file(tmp_path_factory.mktemp("closed")))


@pytest.fixture(scope="module")
def open_to_look(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Endpoints]:
    folder = tmp_path_factory.mktemp("open")
    yield from endpoints_of(access_file(folder, "anyone: observer", users=("ann",)))


# ---- one way to ask at each endpoint; each gives "" or the words of the refusal ------------------

CALLS: dict[str, dict[str, Any]] = {
    "get": {"names": ["sum.s"]},
    "set": {"values": {"sum.a": 0.0}},
    "step": {"n": 1},
    "run": {"until": 0.0},
    "pause": {},
    "reset": {},
    "snapshot": {},
    "restore": {"snapshot": "none"},
    "discard": {"snapshot": "none"},
    "dismiss": {"name": "none"},
    "replace": {"component": "none", "source": f"{PARTS}:Sum"},
}


def at_zenoh(endpoints: Endpoints, user: str | None, call: str) -> str:
    password = None if user is None else PASSWORDS[user]
    try:
        with connect(port=endpoints.zenoh.port, user=user, password=password) as client:
            client._ask(call, **CALLS[call])
    except UuvsimError as error:
        return str(error)
    return ""


def at_tcp(endpoints: Endpoints, user: str | None, call: str) -> str:
    said = {} if user is None else {"user": user, "password": PASSWORDS[user]}
    with Peer(endpoints.tcp.port, **said) as peer:
        if not peer.welcome["ok"]:
            return str(peer.welcome["error"])
        told = peer.ask({"call": call, **CALLS[call]})[0]
        return "" if told["ok"] else str(told["error"])


def at_http(endpoints: Endpoints, user: str | None, call: str, code: str | None = None) -> str:
    if code is None and user is not None:
        code = base64.b64encode(f"{user}:{PASSWORDS[user]}".encode()).decode()
    connection = http.client.HTTPConnection("127.0.0.1", endpoints.http.port)
    try:
        headers = {"Content-Type": "application/json"}
        headers |= {} if code is None else {"Authorization": f"Basic {code}"}
        if call == "get":
            connection.request("GET", "/signals?names=sum.s", headers=headers)
        else:
            body = CALLS[call] if call != "set" else CALLS[call]["values"]
            connection.request("POST", f"/{call}", json.dumps(body), headers)
        told = json.loads(connection.getresponse().read())
        return "" if told["ok"] else str(told["error"])
    finally:
        connection.close()


QuerySender = Callable[[Endpoints, str | None, str], str]
DOORS = pytest.mark.parametrize("ask", [at_zenoh, at_tcp, at_http])


@DOORS
@pytest.mark.parametrize("user", list(guarded.ROLES))
def test_a_role_allows_what_it_allows_and_a_refusal_says_what_it_needs(
    endpoints: Endpoints, ask: QuerySender, user: str
) -> None:
    for call in ("get", "set", "step", "replace", "reset"):
        said = ask(endpoints, user, call)
        if NEEDS[call] in ROLES[guarded.ROLES[user]]:
            assert "needs" not in said
        else:
            assert f"{call}: " in said
            assert f"needs '{NEEDS[call]}'" in said


@DOORS
def test_every_call_needs_a_permission_that_an_observer_lacks_or_has(
    endpoints: Endpoints, ask: QuerySender
) -> None:
    before = endpoints.conductor.moment()
    for call in [call for call, needed in NEEDS.items() if needed != "read"]:
        assert "this call needs" in ask(endpoints, "bob", call)
    assert endpoints.conductor.moment() == before


@DOORS
@pytest.mark.parametrize("user", [None, "bob", "cy", "dee"])
def test_no_code_is_loaded_for_who_is_not_an_owner(
    endpoints: Endpoints,
    ask: QuerySender,
    user: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mark, file = tmp_path / "was_here", tmp_path / "evil.py"
    file.write_text(f"import pathlib; pathlib.Path({str(mark)!r}).touch()\n")
    monkeypatch.setitem(CALLS, "replace", {"component": "sum", "source": f"{file}:E"})
    assert ask(endpoints, user, "replace") != ""
    assert not mark.exists()
    assert "no class" in ask(endpoints, "ann", "replace")
    assert mark.exists()


@DOORS
def test_who_does_not_say_who_he_is_may_do_nothing(endpoints: Endpoints, ask: QuerySender) -> None:
    for call in ("get", "set", "step"):
        said = ask(endpoints, None, call)
        assert said == "this co-simulation requires a login; expected user and password"


@DOORS
def test_a_wrong_password_is_said(
    endpoints: Endpoints, ask: QuerySender, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(PASSWORDS, "dee", "guess")
    assert "user 'dee' or the password is wrong" in ask(endpoints, "dee", "get")


@DOORS
def test_where_anyone_may_look_he_may_look_only(open_to_look: Endpoints, ask: QuerySender) -> None:
    assert ask(open_to_look, None, "get") == ""
    assert "this call needs 'step'" in ask(open_to_look, None, "step")
    assert "this call needs 'set'" in ask(open_to_look, None, "set")
    assert ask(open_to_look, "ann", "step") == ""


@contextmanager
def streaming(endpoints: Endpoints) -> Iterator[None]:
    """Let it run meanwhile: a state just after a subscription may be dropped, not all of them."""
    endpoints.conductor.run(ME, None, 20.0)
    try:
        yield
    finally:
        endpoints.conductor.pause(ME)


# ---- what Zenoh itself lets through ------------------------------------------------------------


def test_one_who_may_read_receives_states(endpoints: Endpoints) -> None:
    port = endpoints.zenoh.port
    with connect(port=port, user="bob", password=PASSWORDS["bob"]) as client:
        assert client.allowed == {"read"}
        with client.subscribe("sum.s") as blocks, streaming(endpoints):
            assert next(blocks).component == "sum"


def test_where_anyone_may_look_states_come_without_a_name(open_to_look: Endpoints) -> None:
    with (
        connect(port=open_to_look.zenoh.port) as client,
        client.subscribe("sum") as blocks,
        streaming(open_to_look),
    ):
        assert next(blocks).component == "sum"


def test_states_do_not_reach_one_who_is_not_known_whatever_he_subscribes_to(
    endpoints: Endpoints,
) -> None:
    guest = client_settings(GUEST, GUEST)
    reader = client_settings(READER, endpoints.zenoh._joined.reader)
    with (
        connecting("127.0.0.1", endpoints.zenoh.port, guest) as stranger,
        connecting("127.0.0.1", endpoints.zenoh.port, reader) as known,
    ):
        takes = [stranger.subscribe(key, 64) for key in ("**", "uuvsim/sums/state/sum")]
        taken = known.subscribe("uuvsim/sums/state/*", 64)
        with streaming(endpoints):
            for _ in range(3):
                assert taken.recv() is not None
        # Once this is answered, all is through.
        assert list(stranger.raw.get("uuvsim/sums/nothing", timeout=PATIENCE)) == []
        assert [one.try_recv() for one in takes] == [None, None]


def test_a_stranger_can_neither_listen_to_calls_nor_forge_states(endpoints: Endpoints) -> None:
    heard: list[Any] = []
    guest = client_settings(GUEST, GUEST)
    port = endpoints.zenoh.port
    with (
        connecting("127.0.0.1", port, guest) as listener,
        connecting("127.0.0.1", port, guest) as stranger,
    ):
        listener.answer("uuvsim/**", heard.append)
        with connect(port=port, user="bob", password=PASSWORDS["bob"]) as client:
            with client.subscribe("sum") as blocks, streaming(endpoints):
                next(blocks)  # it is on its way now
                for _ in range(3):
                    stranger.raw.put("uuvsim/sums/state/sum", bytes(40))
                    list(stranger.raw.get("uuvsim/sums/call/describe", timeout=PATIENCE))
                    assert next(blocks).tick > 0
            assert client.get("sum.s") is not None
        assert stranger.alive("uuvsim/**/live/client/*") == []
    assert heard == []


def test_a_call_in_anothers_name_is_refused(endpoints: Endpoints) -> None:
    port = endpoints.zenoh.port
    with (
        connect(port=port, user="ann", password=PASSWORDS["ann"]) as owner,
        connecting("127.0.0.1", port, client_settings(GUEST, GUEST)) as stranger,
    ):
        for forged in ({}, {"proof": ""}, {"proof": "x" * 32}):
            message = json.dumps({"client": owner._id, **forged})
            reply = next(iter(stranger.raw.get("uuvsim/sums/call/step", payload=message)))
            assert "expected the `proof`" in reply.err.payload.to_string()
        assert owner.step(1) == {}


def test_a_session_of_an_unknown_user_is_not_opened(endpoints: Endpoints) -> None:
    for user, password in (("ann", PASSWORDS["ann"]), (READER, "guess")):
        with pytest.raises(Disconnected):
            connecting("127.0.0.1", endpoints.zenoh.port, client_settings(user, password))


def test_a_password_without_user_is_refused() -> None:
    with pytest.raises(InputInvalid, match="a password without user"):
        connect(password="x")


def test_names_given_where_nobody_asks_do_no_harm() -> None:
    with (
        Bridge(System("sums", "0.1").add("sum", f"{PARTS}:Sum"), port=0) as bridge,
        connect(port=bridge.port, user="ann", password="x") as client,
    ):
        assert client.step(1) == {}
