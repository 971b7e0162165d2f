"""TCP, HTTP and Zenoh take the same calls, refuse the same ones, and carry the same values."""

from __future__ import annotations

import http.client
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.peer import Peer
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.access.authentication import everybody
from uuvsim_cosim.bridge.calls.call_table import CALLS
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.zenoh.session import connecting
from uuvsim_cosim.orchestrator.system.system import System

ME = Client("me", "local")
LARGE = (-(2**63), -(2**53) - 1, 2**53 + 1, 2**63 - 1)


@dataclass
class Server:
    conductor: Conductor
    zenoh: Bridge
    tcp: TcpServer
    http: HttpServer


@pytest.fixture(scope="module")
def server(first_order_fmi3: Path) -> Iterator[Server]:
    """Serve an FMU that has variables of every type."""
    system = System("types", "0.1").add("a", str(first_order_fmi3))
    with (
        Conductor(system, backend="fmu") as conductor,
        Bridge(conductor, port=0, anyone=True) as bridge,
        TcpServer(conductor, 0, admit=everybody) as tcp,
        HttpServer(conductor, 0, admit=everybody) as web,
    ):
        yield Server(conductor, bridge, tcp, web)


# Each asks a call with fields in JSON, and returns (refused, message or answer).

Asked = tuple[bool, Any]
QuerySender = Callable[[Server, str, Any], Asked]


def over_tcp(server: Server, call: str, fields: Any) -> Asked:
    with Peer(server.tcp.port) as peer:
        told, _ = peer.ask({**fields, "call": call})
        return not told["ok"], told if told["ok"] else told["error"]


def over_zenoh(server: Server, call: str, fields: Any) -> Asked:
    with connecting("127.0.0.1", server.zenoh.port) as session:
        asker = session.asker(f"uuvsim/types/call/{call}")
        reply = next(iter(asker.get(payload=json.dumps(fields))))
        if reply.ok is None:
            return True, json.loads(reply.err.payload.to_bytes())["message"]
        return False, json.loads(reply.ok.payload.to_bytes())


def over_http(server: Server, call: str, fields: Any, raw: bytes | None = None) -> Asked:
    link = http.client.HTTPConnection("127.0.0.1", server.http.port)
    try:
        if call == "get":
            link.request("GET", f"/signals?names={','.join(fields['names'])}")
        else:
            body = fields["values"] if call == "set" and "values" in fields else fields
            data = json.dumps(body).encode() if raw is None else raw
            link.request("POST", f"/{call}", data, {"Content-Type": "application/json"})
        told = json.loads(link.getresponse().read())
        return not told["ok"], told if told["ok"] else told["error"]
    finally:
        link.close()


EACH: tuple[QuerySender, ...] = (over_tcp, over_http, over_zenoh)

WRONG: list[tuple[str, Any, str]] = [
    ("step", {"m": 5}, "field 'm' does not exist"),
    ("step", {"N": 5}, "field 'N' does not exist"),
    ("step", {"n": 0}, "whole number of steps from 1"),
    ("step", {"n": -1}, "whole number of steps from 1"),
    ("step", {"n": 1.5}, "whole number of steps from 1"),
    ("step", {"n": True}, "whole number of steps from 1"),
    ("step", {"n": "2"}, "whole number of steps from 1"),
    ("step", {"n": [2]}, "whole number of steps from 1"),
    ("step", {"n": 10**400}, "whole number of steps from 1"),
    ("step", {"n": 1, "dt": 0.1}, "both n and dt"),
    ("step", {"dt": 0.05}, "whole multiple"),
    ("step", {"dt": 0}, "expected 0.1 s or more"),
    ("step", {"dt": "0.1"}, "expected a number"),
    ("step", {"inputs": [1, 2]}, "an object of names and values"),
    ("step", {"inputs": {"a.u": 1.0}, "outputs": "a.yy"}, "a.y"),
    ("step", {"outputs": 3}, "a list of names"),
    ("step", {"outputs": ["a.y", 3]}, "a list of names"),
    ("step", {"outputs": {"a.y": 1}}, "a list of names"),
    ("set", {"values": {"a.u": True}}, "a value of type Float64"),
    ("set", {"values": {"a.u": [1.0]}}, "expected a scalar"),
    ("set", {"values": {"a.u": [[1.0]]}}, "expected a scalar"),
    ("set", {"values": {"a.u": None}}, "a.u"),
    ("set", {"values": {"a.u": 6.0}}, "out of range"),
    ("set", {"values": {"a.u": "1 kg"}}, "kg"),
    ("set", {"values": {"a.u": 1e999}}, "is no JSON"),
    ("set", {"values": {"a.v": [[1.0, 2.0, 3.0]]}}, "3 values of type Float64"),
    ("set", {"values": {"a.v": [1.0, [2.0], 3.0]}}, "lists of different lengths"),
    ("set", {"values": {"a.v": [1.0, True, 3.0]}}, "values of type Float64"),
    ("set", {"values": {"a.v": [1.0, "2", 3.0]}}, "values of type Float64"),
    ("set", {"values": {"a.v": 1.0}}, "a scalar; expected 3 values"),
    ("set", {"values": {"a.int8_in": 128}}, "Int8"),
    ("set", {"values": {"a.int8_in": 0.5}}, "Int8"),
    ("set", {"values": {"a.int64_in": 2**63}}, "Int64"),
    ("set", {"values": {"a.uint64_in": -1}}, "UInt64"),
    ("set", {"values": {"a.boolean_in": 2}}, "Boolean"),
    ("set", {"values": {"a.y": 1.0}}, "output"),
    ("set", {"values": {"a.uu": 1.0}}, "a.u"),
    ("set", {"values": {"a.v[1]": 1.0}}, "one element"),
    ("set", {"values": [1]}, "an object"),
    ("run", {"until": "noon"}, "expected a number"),
    ("run", {"until": True}, "expected a number"),
    ("run", {"until": 1.0, "duration": 1.0}, "both until and duration"),
    ("run", {"until": 1.0, "factor": 0}, "more than 0"),
    ("run", {"until": 1.0, "factor": "fast"}, "more than 0"),
    ("run", {"until": 1.0, "record": ["a.yy"]}, "a.y"),
    ("run", {"untill": 1.0}, "did you mean until"),
    ("run", {"until": -1.0}, "expected a time after"),
    ("run", {"record": ["a.y"]}, "without until"),
    ("reset", {"seed": 1.5}, "whole number"),
    ("reset", {"seed": True}, "whole number"),
    ("reset", {"seed": "x"}, "whole number"),
    ("reset", {"start": {"a.u": True}}, "Float64"),
    ("reset", {"starts": {}}, "did you mean start"),
    ("pause", {"now": True}, "expected some of none"),
    ("snapshot", {"name": "x"}, "expected some of none"),
    ("restore", {}, "snapshot is missing"),
    ("restore", {"snapshot": 1}, "the name of a snapshot"),
    ("restore", {"snapshot": "s99"}, "no snapshot 's99'"),
    ("discard", {"snapshot": "s99"}, "no snapshot 's99'"),
    ("replace", {"component": "a"}, "source is missing"),
    ("replace", {"component": "a", "source": 1}, "a source"),
    ("replace", {"component": "a", "source": "x.fmu", "mapping": ["u"]}, "name: name"),
    ("replace", {"component": "a", "source": "x.fmu", "mapping": {"u": 1}}, "name: name"),
    ("dismiss", {"name": "nobody"}, "no client 'nobody' holds time"),
    ("dismiss", {}, "name is missing"),
]


@pytest.mark.parametrize(("call", "fields", "words"), WRONG)
def test_a_wrong_request_is_refused_over_each_transport_in_the_same_words(
    server: Server, call: str, fields: Any, words: str
) -> None:
    server.conductor.reset(ME)
    said = [ask(server, call, fields) for ask in EACH]
    assert all(refused for refused, _ in said), said
    assert all(words in message for _, message in said), said
    if "JSON" not in words and fields.get("values") != [1]:  # those name the place of the text
        assert len({message for _, message in said}) == 1, said
    assert server.conductor.moment().tick == 0
    assert server.conductor.get(ME, ["a.u"]) == {"a.u": 0.0}


@pytest.mark.parametrize("text", [b'{"n": NaN}', b'{"n": 1, "n": 5}', b"{", b"[]", b'{"n":1}}'])
def test_a_text_that_is_no_json_object_is_refused_over_each_transport(
    server: Server, text: bytes
) -> None:
    server.conductor.reset(ME)
    assert over_http(server, "step", {}, text)[0]
    with Peer(server.tcp.port) as peer:
        peer.socket.sendall(len(text).to_bytes(4, "little") + bytes(4) + text)
        assert not peer.answer()[0]["ok"]
    with connecting("127.0.0.1", server.zenoh.port) as session:
        asker = session.asker("uuvsim/types/call/step")
        assert next(iter(asker.get(payload=text))).ok is None
    assert server.conductor.moment().tick == 0


RIGHT: list[tuple[str, Any, int]] = [
    ("step", {}, 1),
    ("step", {"n": 3, "inputs": {"a.u": 1}, "outputs": ["a.y"]}, 3),
    ("step", {"n": 3.0, "outputs": "a.y"}, 3),
    ("step", {"dt": 0.2, "n": None}, 2),
    ("step", {"n": [], "inputs": [], "dt": 0.2}, 2),  # as MATLAB writes what is not given
    ("set", {"values": {"a.u": "0.02 m", "a.v": [1, 2, 3], "a.boolean_in": True}}, 0),
    ("set", {"values": {"a.m": [1, 2, 3, 4]}}, 0),
    ("set", {"values": {"a.m": [[1, 2], [3, 4]]}}, 0),
    ("run", {"until": 0.5, "record": ["a.y"]}, 5),
    ("run", {"duration": 0.5, "record": "a.y"}, 5),
    ("reset", {"seed": 7, "start": {"a.u": 2}}, 0),
    ("reset", {"seed": 2**70}, 0),
    ("pause", {}, 0),
]


@pytest.mark.parametrize(("call", "fields", "tick"), RIGHT)
def test_a_right_request_is_answered_alike_over_each_transport(
    server: Server, call: str, fields: Any, tick: int
) -> None:
    states = []
    for ask in EACH:
        server.conductor.reset(ME, start={"a.u": 0.0})
        refused, told = ask(server, call, fields)
        assert not refused, told
        assert server.conductor.moment().tick == tick
        states.append(str(server.conductor.get(ME, ["a.u", "a.y", "a.v", "a.m", "a.boolean_in"])))
    assert len(set(states)) == 1


def test_every_call_is_offered_over_each_transport(server: Server) -> None:
    for call in set(CALLS) - {"describe", "schema", "get", "leave"}:
        for ask in EACH:
            told = str(ask(server, call, {"nonsense": 1})[1])
            assert "nonsense" in told, (call, told)
    for call in ("describe", "schema"):
        assert not over_tcp(server, call, {})[0]
        assert not over_zenoh(server, call, {})[0]


# ---- integers of 64 bits ----------------------------------------------------------------------


@pytest.mark.parametrize("ask", EACH)
@pytest.mark.parametrize(
    ("name", "value"),
    [*(("int64", v) for v in LARGE), *(("uint64", v) for v in (2**53 + 1, 2**63, 2**64 - 1))],
)
def test_an_integer_of_64_bits_is_exact_in_json(
    server: Server, ask: QuerySender, name: str, value: int
) -> None:
    server.conductor.reset(ME)
    refused, told = ask(server, "step", {"inputs": {f"a.{name}_in": value}})
    assert not refused, told
    assert server.conductor.get(ME, [f"a.{name}_out"]) == {f"a.{name}_out": value}
    if ask is not over_tcp:  # whose numbers are not in JSON
        told = ask(server, "get", {"names": [f"a.{name}_out"]})[1]
        assert told["values"] == {f"a.{name}_out": value}


@pytest.mark.parametrize(("name", "value"), [("int64", 2**63 - 1), ("uint64", 2**64 - 1)])
def test_an_integer_of_64_bits_is_exact_over_tcp(server: Server, name: str, value: int) -> None:
    server.conductor.reset(ME)
    bits = value.to_bytes(8, "little")
    with Peer(server.tcp.port) as peer:
        column = {"name": f"a.{name}_in", "format": name, "shape": []}
        peer.ask({"call": "set", "columns": [column]}, peer.bits(bits))
        asked = {"call": "step", "outputs": [f"a.{name}_out"]}
        refused, _ = peer.ask(asked)
        assert f"{value} is not exact as float64" in refused["error"]
        told, numbers = peer.ask({**asked, "integers": True})
        assert told["columns"][0]["format"] == name
        assert numbers.tobytes() == bits


def test_an_integer_of_64_bits_is_exact_in_the_compact_step(server: Server) -> None:
    server.conductor.reset(ME)
    bits = (-(2**63) + 1).to_bytes(8, "little", signed=True)
    layout = {"call": "layout", "inputs": ["a.int64_in"], "outputs": ["a.y", "a.int64_out"]}
    with Peer(server.tcp.port) as peer:
        told, _ = peer.ask({**layout, "integers": True})
        assert told["inputs"][0]["format"] == told["outputs"][1]["format"] == "int64"
        numbers = peer.ask(None, [1.0, *peer.bits(bits)])[1]
        assert (numbers[0], numbers[3:].tobytes()) == (1.0, bits)
        assert "format" not in peer.ask(layout)[0]["inputs"][0]
        assert peer.ask(None, [1.0, 7.0])[1][3] == 7.0


def test_an_integer_of_64_bits_is_exact_in_a_recorded_run_over_each_transport(
    server: Server,
) -> None:
    asked = {"until": 0.3, "record": ["a.int64_out", "a.uint64_out", "a.uint64_in"]}
    for ask in (over_http, over_zenoh):
        server.conductor.reset(ME, start={"a.int64_in": -(2**63), "a.uint64_in": 2**64 - 1})
        values = ask(server, "run", asked)[1]["values"]
        assert values["a.int64_out"][1:] == [-(2**63)] * 3
        assert values["a.uint64_out"][1:] == [2**64 - 1] * 3
        assert values["a.uint64_in"] == [2**64 - 1] * 4
    server.conductor.reset(ME, start={"a.uint64_in": 2**64 - 1})
    with Peer(server.tcp.port) as peer:
        told, numbers = peer.ask({"call": "run", "integers": True, **asked})
        assert told["columns"][3] == {
            "name": "a.uint64_in", "type": "UInt64", "shape": [4], "format": "uint64",
        }  # fmt: skip
        assert numbers[-4:].tobytes() == b"\xff" * 32


def test_an_integer_of_64_bits_is_exact_in_the_python_client(server: Server) -> None:
    server.conductor.reset(ME)
    with connect(port=server.zenoh.port) as client, client.subscribe("a") as blocks:
        assert server.zenoh.stream.wait_until_wanted("a", timeout=PATIENCE)
        for large in LARGE:
            client.set({"a.int64_in": large, "a.uint64_in": large + 2**63})
            given = client.step(1, {}, ["a.int64_out", "a.uint64_out"])
            assert given == {"a.int64_out": large, "a.uint64_out": large + 2**63}
            block = next(blocks)
            assert block.tick == client.tick
            assert block["a.int64_out"] == large
            assert block["a.uint64_out"] == large + 2**63
            assert block["a.y"] == client.get("a.y")


def test_zenoh_payloads_name_their_encoding(server: Server) -> None:
    with connecting("127.0.0.1", server.zenoh.port) as session:
        subscriber = session.subscribe("uuvsim/types/state/a", 4)
        assert server.zenoh.stream.wait_until_wanted("a", timeout=PATIENCE)
        for call, fields in (("describe", {}), ("stpe", {})):
            asker = session.asker(f"uuvsim/types/call/{call}")
            reply = next(iter(asker.get(payload=json.dumps(fields))))
            found = reply.err if reply.ok is None else reply.ok
            assert str(found.encoding) == "application/json", (call, fields)
        server.conductor.step(ME)
        encoding = str(subscriber.recv().encoding)
        assert encoding == "application/octet-stream;uuvsim-state"
