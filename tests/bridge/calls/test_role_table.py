"""Every role, every call, every transport: allowed or refused, as this table has it."""

from __future__ import annotations

import base64
import contextlib
import http.client
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.guarded import PASSWORDS, ROLES, access_file
from tests.bridge.peer import Peer
from uuvsim_cosim.bridge.access.access_file import read_access
from uuvsim_cosim.bridge.access.authentication import Authenticator
from uuvsim_cosim.bridge.calls.call_table import CALLS
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.http.sessions import HEADER
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")
EVERYBODY = ("observer", "operator", "controller", "owner")
STEPPING = ("controller", "owner")

# Call: the roles that may make it, and fields that are right.
TABLE: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "describe": (EVERYBODY, {}),
    "schema": (EVERYBODY, {}),
    "get": (EVERYBODY, {"names": ["sum.s"]}),
    "set": (("operator", "controller", "owner"), {"values": {"sum.a": 1.0}}),
    "step": (STEPPING, {"n": 1}),
    "run": (STEPPING, {"duration": 0.1}),
    "pause": (STEPPING, {}),
    "reset": (STEPPING, {}),
    "snapshot": (STEPPING, {}),
    "restore": (STEPPING, {"snapshot": "s1"}),
    "discard": (STEPPING, {"snapshot": "s2"}),
    "replace": (("owner",), {"component": "sum", "source": f"{PARTS}:Sum"}),
    "dismiss": (("owner",), {"name": "nobody"}),
    "join": (EVERYBODY, {}),
    "leave": (EVERYBODY, {}),
}
USERS = {role: user for user, role in ROLES.items()}


@dataclass
class Server:
    conductor: Conductor
    zenoh: Bridge
    tcp: TcpServer
    http: HttpServer


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    authenticator = Authenticator(read_access(access_file(tmp_path_factory.mktemp("access"))))
    with (
        Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as conductor,
        Bridge(conductor, port=0, access=authenticator) as bridge,
        TcpServer(conductor, 0, admit=authenticator) as tcp,
        HttpServer(conductor, 0, admit=authenticator) as web,
    ):
        yield Server(conductor, bridge, tcp, web)


# Each opens a connection of a role, and gives what makes a call: "" or the refusal's words.
Making = Callable[[str, dict[str, Any]], str]


@contextmanager
def over_zenoh(server: Server, role: str, **joining: Any) -> Iterator[Making]:
    user = USERS[role]
    with connect(port=server.zenoh.port, user=user, password=PASSWORDS[user], **joining) as client:

        def make(call: str, fields: dict[str, Any]) -> str:
            try:
                client._ask(call, **fields)
            except UuvsimError as error:
                return str(error)
            return ""

        yield make


@contextmanager
def over_tcp(server: Server, role: str, **joining: Any) -> Iterator[Making]:
    user = USERS[role]
    with Peer(server.tcp.port, user=user, password=PASSWORDS[user], **joining) as peer:
        if not peer.welcome["ok"]:
            raise UuvsimError(peer.welcome["error"])

        def make(call: str, fields: dict[str, Any]) -> str:
            return str(peer.ask({"call": call, **fields})[0].get("error", ""))

        yield make


@contextmanager
def over_http(server: Server, role: str, **joining: Any) -> Iterator[Making]:
    user = USERS[role]
    code = base64.b64encode(f"{user}:{PASSWORDS[user]}".encode()).decode()
    link = http.client.HTTPConnection("127.0.0.1", server.http.port)
    headers = {"Authorization": f"Basic {code}", "Content-Type": "application/json"}

    def make(call: str, fields: dict[str, Any]) -> str:
        if call in ("describe", "schema", "pilots"):
            link.request("GET", f"/{call}", headers=headers)
        elif call in ("get", "live"):
            path = "signals" if call == "get" else call
            link.request("GET", f"/{path}?names={fields['names'][0]}", headers=headers)
        else:
            body = fields["values"] if call == "set" else fields
            link.request("POST", f"/{call}", json.dumps(body), headers)
        answer = link.getresponse()
        if answer.getheader("Content-Type") == "text/event-stream":
            link.close()
            return ""
        told = json.loads(answer.read())
        assert told["ok"] or (answer.status == 403) == ("needs" in told["error"]), told
        if "session" in told:
            headers[HEADER] = told["session"]
        return "" if told["ok"] else str(told["error"])

    with contextlib.closing(link):
        if joining and (refused := make("join", joining)):
            raise UuvsimError(refused)
        yield make
        if joining:
            assert make("leave", {}) == ""


Opening = Callable[..., AbstractContextManager[Making]]
EACH = pytest.mark.parametrize("opening", [over_tcp, over_http, over_zenoh])
ROLE = pytest.mark.parametrize("role", EVERYBODY)


def test_the_table_has_every_call_and_every_role() -> None:
    assert TABLE.keys() == CALLS.keys()
    assert set(EVERYBODY) == set(ROLES.values())


@EACH
@ROLE
def test_a_role_makes_the_calls_of_its_row_and_no_others(
    server: Server, opening: Opening, role: str
) -> None:
    server.conductor.reset(ME)
    for call, (roles, fields) in TABLE.items():
        if call == "leave":
            continue  # below: it ends the connection
        before = server.conductor.moment(), server.conductor.get(ME, ["sum.a"])
        with opening(server, role) as make:
            said = make(call, fields)
        if role in roles:
            assert "needs" not in said, (call, said)
        else:
            assert f"{call}: " in said
            assert f"needs '{CALLS[call].needs}'" in said, (call, said)
            assert (server.conductor.moment(), server.conductor.get(ME, ["sum.a"])) == before, call


@EACH
@ROLE
def test_only_a_role_that_steps_holds_time(server: Server, opening: Opening, role: str) -> None:
    if role in STEPPING:
        with opening(server, role, lockstep=True, name=role):
            clients = server.conductor.describe()["clients"]
            assert [c["lockstep"] for c in clients if c["name"] == role] == [True]
    else:
        with (
            pytest.raises(UuvsimError, match="may not step"),
            opening(server, role, lockstep=True, name=role),
        ):
            pass
    while server.conductor.describe()["mode"] != "free":
        pass  # until the server has noticed that the connection closed


@ROLE
def test_every_role_leaves(server: Server, role: str) -> None:
    with over_zenoh(server, role):
        pass  # its end is a `leave`, which raises what is refused
    with over_http(server, role, name=role):
        pass  # the same
    with over_tcp(server, role) as make:
        assert make("bye", {}) == ""


@ROLE
@pytest.mark.parametrize(
    ("call", "roles"),
    [
        ("live", EVERYBODY),
        ("pilots", EVERYBODY),
        ("pilot", ("operator", "controller", "owner")),
    ],
)
def test_a_role_makes_the_calls_that_only_http_has(
    server: Server, role: str, call: str, roles: tuple[str, ...]
) -> None:
    with over_http(server, role) as make:
        assert ("needs" in make(call, {"names": ["sum.s"]})) == (role not in roles)
