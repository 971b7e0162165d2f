"""Parameters, services and inputs over Foxglove's protocol, and mistakes of clients."""

from __future__ import annotations

import itertools
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import uuvsim_cosim as uuv
from tests.bridge.foxglove.client import FoxgloveClient, connected
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.foxglove.permissions import Permissions
from uuvsim_cosim.bridge.foxglove.server import FoxgloveServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")


@pytest.fixture
def sums() -> Iterator[Conductor]:
    with Conductor(uuv.System("sums", "0.1").add("a", f"{PARTS}:Sum")) as made:
        yield made


@pytest.fixture
def server(sums: Conductor) -> Iterator[FoxgloveServer]:
    with FoxgloveServer(sums, 0) as made:
        yield made


@pytest.fixture
def client(server: FoxgloveServer) -> Iterator[FoxgloveClient]:
    with connected(server.port) as made:
        yield made


def until(condition: Callable[[], bool], client: FoxgloveClient) -> None:
    """Exchange parameters with the server until a condition holds."""
    for _ in range(10_000):
        if condition():
            return
        client.parameters()
    raise AssertionError("the condition did not hold")


# ---- parameters --------------------------------------------------------------------------------


def test_tunable_parameters_are_listed_and_only_these(client: FoxgloveClient) -> None:
    assert client.parameters() == {"a.k": 1.0}
    assert client.parameters("a.k", "a.a", "a.nothing") == {"a.k": 1.0}


def test_a_parameter_is_set_in_the_system(sums: Conductor, client: FoxgloveClient) -> None:
    assert client.set(a__k=3) == {"a.k": 3.0}
    assert sums.get(ME, ["a.k"])["a.k"] == 3.0


def test_matrices_are_nested_lists_and_come_back_the_same() -> None:
    boat = uuv.System("boat", "0.1").add("hull", "model:bluerov2_heavy")
    with (
        Conductor(boat) as conductor,
        FoxgloveServer(conductor, 0) as server,
        connected(server.port) as client,
    ):
        listed = client.parameters()
        shapes = {i.name: i.shape for i in conductor.schema()}
        for name, value in listed.items():
            assert conductor.get(ME, [name])[name] == pytest.approx(value), name
        vectors = [name for name in listed if len(shapes[name]) >= 1]
        assert vectors
        client.send(op="setParameters", id="set", parameters=[
            {"name": name, "value": listed[name]} for name in vectors
        ])  # fmt: skip
        client.wait(lambda m: m.get("id") == "set")
        assert client.statuses == []


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"a__a": 1.0}, "a.a: is no tunable parameter; expected one that is listed"),
        ({"a__none": 1.0}, "a.none: is no tunable parameter; expected one that is listed"),
        ({"a__k": "much"}, "a.k: 'much'; expected a value of type Float64"),
        ({"a__k": True}, "a.k: True; expected a value of type Float64"),
        ({"a__k": [1.0, 2.0]}, "a.k: "),
        ({"a__k": {"x": 1.0}}, "a.k: a dict; expected a value of type Float64"),
        ({"a__k": []}, "a.k: "),
    ],
)
def test_a_wrong_parameter_is_refused_with_its_reason(
    client: FoxgloveClient, values: dict[str, Any], message: str
) -> None:
    client.set(**values)
    assert client.status().startswith(message)
    assert client.parameters() == {"a.k": 1.0}


def test_of_several_parameters_all_are_set_or_none(client: FoxgloveClient) -> None:
    assert client.set(a__k=2.0, a__none=1.0) == {"a.k": 1.0}


def test_a_parameter_cannot_be_removed(client: FoxgloveClient) -> None:
    client.send(op="setParameters", parameters=[{"name": "a.k"}], id="set")
    assert client.status() == "a.k: no value; expected a value: parameters cannot be removed"


def test_a_subscriber_learns_what_another_client_has_set(
    sums: Conductor, server: FoxgloveServer, client: FoxgloveClient
) -> None:
    client.send(op="subscribeParameterUpdates", parameterNames=["a.k"])
    values = itertools.count(2)
    done = threading.Event()

    def keep_setting() -> None:
        while not done.wait(0.05):
            sums.set(ME, {"a.k": float(next(values))})

    setting = threading.Thread(target=keep_setting)
    setting.start()
    told = client.wait(lambda m: m["op"] == "parameterValues" and "id" not in m)
    done.set()
    setting.join()
    [parameter] = told["parameters"]
    assert parameter["name"] == "a.k"
    assert parameter["value"] >= 2.0


# ---- services ----------------------------------------------------------------------------------


def test_a_service_steps_with_inputs_and_returns_outputs(client: FoxgloveClient) -> None:
    request = {"n": 2, "inputs": {"a.a": 1.5}, "outputs": ["a.s"]}
    answer = client.call("/step", request)
    assert answer["time"] == pytest.approx(0.2)
    assert answer["values"]["a.s"] == pytest.approx(0.3)


def test_services_resume_pause_and_reset(sums: Conductor, client: FoxgloveClient) -> None:
    assert client.call("/resume", {"factor": 10.0})["running"]
    assert sums.moment().running
    assert not client.call("/pause")["running"]
    client.call("/step")
    assert client.call("/reset")["tick"] == 0
    assert not sums.moment().running


@pytest.mark.parametrize(
    ("service", "request_", "message"),
    [
        ("/step", b'{"n": 0}', "step: n 0 was read; expected a whole number of steps from 1"),
        ("/step", b'{"m": 1}', "step: field 'm' does not exist; expected n, dt, inputs, outputs"),
        ("/step", b'{"dt": NaN}', "step: not JSON (NaN is no JSON); expected a JSON object"),
        ("/step", b"[1]", "step: a JSON list was read; expected an object"),
        ("/step", b"\xff\xfe{", "step: not JSON"),
        ("/step", b'{"inputs": {"a.b": [1, [2]]}}', "a.b: "),
        ("/step", b'{"outputs": ["a.t"]}', "no signal 'a.t'; expected one such as a.s"),
        ("/reset", b'{"seed": "x"}', "reset: seed 'x' was read; expected a whole number"),
        ("/pause", b'{"now": 1}', "pause: field 'now' does not exist; expected an empty object"),
        ("/resume", b'{"until": 3}', "resume: field 'until' does not exist; expected factor"),
    ],
)
def test_a_wrong_request_of_a_service_fails_with_its_reason(
    client: FoxgloveClient, service: str, request_: bytes, message: str
) -> None:
    assert client.call(service, raw=request_).startswith(f"InputInvalid: {message}")


def test_a_service_that_waits_ends_with_the_server(sums: Conductor) -> None:
    with FoxgloveServer(sums, 0) as server, connected(server.port) as client:
        client.ask("/step", {"n": 10**12})
        client.subscribe("/a")
        client.message("/a", lambda m: m["at"] > 0)  # the step has begun
        client.call("/step")  # refused: it is answered while the other waits
    until_idle = Client("after", "local")
    sums.pause(until_idle)
    assert not sums.moment().running


def test_a_step_of_a_client_that_has_gone_can_be_paused(
    server: FoxgloveServer, sums: Conductor
) -> None:
    with connected(server.port) as gone:
        gone.ask("/step", {"n": 10**12})
        gone.subscribe("/a")
        gone.message("/a", lambda m: m["at"] > 0)
        gone.raw.socket.close()
    with connected(server.port) as client:
        client.call("/pause")
        client.call("/reset")
        assert client.call("/step")["tick"] == 1


# ---- inputs ------------------------------------------------------------------------------------


def test_a_published_message_sets_the_inputs_of_a_component(
    sums: Conductor, client: FoxgloveClient
) -> None:
    client.publish("/a", b'{"a": 2.5, "b": 1}')
    until(lambda: sums.get(ME, ["a.a"])["a.a"] == 2.5, client)
    assert sums.get(ME, ["a.b"])["a.b"] == 1.0


@pytest.mark.parametrize(
    ("topic", "encoding", "message", "report"),
    [
        ("/c", "json", b"{}", "/c: is no component with inputs; expected /a"),
        ("/a", "cdr", b"{}", "/a: encoding 'cdr'; expected json"),
        ("/a", "json", b'{"a": "x"}', "a.a: 'x'; expected a value of type Float64"),
        ("/a", "json", b'{"s": 1}', "a.s: "),
        ("/a", "json", b'{"a": NaN}', "/a: not JSON (NaN is no JSON); expected a JSON object"),
        ("/a", "json", b"\x00\x01", "/a: not JSON"),
    ],
)
def test_a_wrong_published_message_is_reported(
    client: FoxgloveClient, topic: str, encoding: str, message: bytes, report: str
) -> None:
    client.publish(topic, message, encoding=encoding)
    assert client.status().startswith(report)


def test_of_a_flood_the_newest_input_counts_and_steps_go_on(
    sums: Conductor, client: FoxgloveClient
) -> None:
    flood = [b'{"a": %d}' % k for k in range(20_000)]
    client.publish("/a", *flood)
    for _ in range(100):
        sums.step(ME)
    until(lambda: sums.get(ME, ["a.a"])["a.a"] == 19_999.0, client)
    assert sums.moment().tick == 100


def test_a_flood_of_one_mistake_is_reported_at_most_once_a_second(client: FoxgloveClient) -> None:
    for _ in range(100):
        client.set(a__k="much")
    client.parameters()
    assert 1 <= len(client.statuses) < 50


# ---- mistakes of clients -----------------------------------------------------------------------


def test_malformed_messages_are_answered_and_the_connection_stays(client: FoxgloveClient) -> None:
    service = client.services["/step"]["id"]
    malformed = [
        "{rubbish", "[]", '{"op": "nothing"}', "", '{"op": "subscribe"}', '{"op": 3}',
        '{"op": "setParameters", "parameters": [{"name": "a.k", "value": null}]}',
        '{"op": "setParameters", "parameters": [{"name": "a.k", "value": [1, [2]]}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 999999}]}',
        b"", b"\xff", b"\x02", b"\x02\x01\x00", b"\x01\x63\x00\x00\x00{}",
        struct.pack("<BIII", 2, service, 1, 4_000_000_000) + b"json",
    ]  # fmt: skip
    for message in malformed:
        client.raw.send(message)
    assert client.parameters() == {"a.k": 1.0}
    assert len(client.statuses) >= 8


def test_another_subprotocol_is_refused(server: FoxgloveServer) -> None:
    with pytest.raises(InvalidStatus), connect(f"ws://127.0.0.1:{server.port}", proxy=None):
        pass


def test_clients_that_come_and_go_during_resets_do_not_block_the_server(
    server: FoxgloveServer, sums: Conductor
) -> None:
    failures: list[BaseException] = []

    def visit() -> None:
        try:
            for _ in range(10):
                with connected(server.port) as visitor:
                    visitor.subscribe("/a", "/tf")
                    visitor.parameters()
                    visitor.raw.socket.close()
        except BaseException as error:
            failures.append(error)

    visitors = [threading.Thread(target=visit) for _ in range(8)]
    for one in visitors:
        one.start()
    while any(one.is_alive() for one in visitors):
        sums.step(ME, 20)
        sums.replace(ME, "a", f"{PARTS}:Sum")
        sums.reset(ME)
    assert failures == []
    with connected(server.port) as client:
        client.subscribe("/a")
        assert client.message("/a")["data"]["s"] == 0.0


def test_two_servers_show_their_own_system(server: FoxgloveServer) -> None:
    other = uuv.System("other", "0.1").add("b", f"{PARTS}:Twice")
    with (
        Conductor(other) as conductor,
        FoxgloveServer(conductor, 0) as second,
        connected(server.port) as one,
        connected(second.port) as two,
    ):
        assert set(one.advertised(2)) == {"/a", "/tf"}
        assert set(two.advertised(2)) == {"/b", "/tf"}


def test_a_port_in_use_is_named(server: FoxgloveServer, sums: Conductor) -> None:
    with pytest.raises(
        InputInvalid,
        match=rf"Foxglove at 127.0.0.1:{server.port}: Failed to bind port: .*expected a free port",
    ):
        FoxgloveServer(sums, server.port)
    sums.step(ME)  # the server that failed watches no more


def test_without_the_package_the_extra_is_named(
    sums: Conductor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(InputInvalid, match=r"pip install 'uuvsim-cosim\[foxglove\]'"):
        FoxgloveServer(sums, 0)


def test_a_client_that_may_only_read_is_given_the_reason(sums: Conductor) -> None:
    only = Permissions(allowed=frozenset({"read"}), reason="Foxglove's clients cannot log in")
    with FoxgloveServer(sums, 0, only) as server, connected(server.port) as client:
        assert "clientPublish" not in client.info["capabilities"]
        assert client.parameters() == {"a.k": 1.0}
        assert client.set(a__k=2.0) == {"a.k": 1.0}
        assert client.status().endswith("Foxglove's clients cannot log in")
        for service in ("/step", "/reset", "/pause", "/resume"):
            assert client.call(service).endswith("Foxglove's clients cannot log in")
    assert sums.moment().tick == 0


def test_a_server_outlives_its_system(sums: Conductor, server: FoxgloveServer) -> None:
    with connected(server.port) as client:
        sums.close()
        assert "the co-simulation has ended" in client.call("/step")
        client.set(a__k=2.0)
        assert "the co-simulation has ended" in client.status()
