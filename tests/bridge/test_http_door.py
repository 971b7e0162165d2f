"""The HTTP door: JSON there and back, a page, live values; what browsers are not made to do."""

from __future__ import annotations

import base64
import http.client
import json
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.http_door import HttpDoor
from uuvsim_cosim.bridge.wire import Limits
from uuvsim_cosim.errors import InputInvalid

sys.path.insert(0, str(Path(__file__).parent))

from fake_desk import DECAY, STEP, FakeDesk

BRIEF = Limits(clients=4, frame_s=0.3)


@pytest.fixture
def desk() -> FakeDesk:
    return FakeDesk()


@pytest.fixture
def door(desk: FakeDesk) -> Iterator[HttpDoor]:
    with HttpDoor(desk, 0, limits=BRIEF) as opened:
        yield opened


@pytest.fixture
def conducted() -> Iterator[HttpDoor]:
    sums = uuv.System("sums", "0.1").add("sum", f"{Path(__file__).parent / 'parts.py'}:Sum")
    with Conductor(sums) as conductor, HttpDoor(conductor, 0) as opened:
        yield opened


def ask(
    door: HttpDoor, method: str, path: str, body: Any = None, **headers: str
) -> tuple[int, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", door.port, timeout=10.0)
    try:
        data = None if body is None else json.dumps(body).encode()
        said = {"Content-Type": "application/json"} if body is not None else {}
        connection.request(method, path, data, {**said, **headers})
        answer = connection.getresponse()
        read = answer.read()
        kind = answer.getheader("Content-Type", "")
        return answer.status, json.loads(read) if "json" in kind else read.decode()
    finally:
        connection.close()


def test_values_are_set_and_steps_made_and_outputs_given(door: HttpDoor) -> None:
    assert ask(door, "POST", "/set", {"plant.u": [1, -2]})[0] == 200
    status, read = ask(door, "POST", "/step", {"n": 3, "outputs": ["plant.y"]})
    assert (status, read["tick"], read["running"]) == (200, 3, False)
    expected = [1 - DECAY**3, -2 * (1 - DECAY**3)]
    assert read["values"]["plant.y"] == pytest.approx(expected)
    inputs = {"plant.u": [0, 0]}
    read = ask(door, "POST", "/step", {"dt": STEP, "inputs": inputs, "outputs": ["plant.y"]})[1]
    assert read["values"]["plant.y"] == pytest.approx([DECAY * x for x in expected])
    values = ask(door, "GET", "/signals?names=plant.y,plant.mode")[1]["values"]
    assert values == {"plant.y": read["values"]["plant.y"], "plant.mode": "free"}


def test_it_says_what_there_is(door: HttpDoor) -> None:
    assert ask(door, "GET", "/describe")[1]["system"]["system"] == "fake"
    signals = ask(door, "GET", "/schema")[1]["signals"]
    assert signals[0] == {
        "name": "plant.u",
        "type": "Float64",
        "shape": [2],
        "unit": "N",
        "causality": "input",
        "settable": True,
        "description": "force",
    }


def test_a_run_is_recorded_and_a_snapshot_restored(door: HttpDoor) -> None:
    kept = ask(door, "POST", "/snapshot")[1]["snapshot"]
    run = {"duration": 0.05, "record": ["plant.y"]}
    first = ask(door, "POST", "/run", run)[1]["values"]
    assert len(first["time"]) == len(first["plant.y"]) == 5
    assert ask(door, "POST", "/restore", {"snapshot": kept})[1]["tick"] == 0
    assert ask(door, "POST", "/run", run)[1]["values"] == first
    assert ask(door, "POST", "/run", {"factor": 1})[1]["running"]
    assert not ask(door, "POST", "/pause")[1]["running"]
    assert ask(door, "POST", "/reset", {"start": {"plant.count": 9}})[1]["tick"] == 0
    assert ask(door, "GET", "/signals?names=plant.count")[1]["values"]["plant.count"] == 9


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "words"),
    [
        ("GET", "/descibe", None, 404, "near names: describe"),
        ("GET", "/step", None, 405, "by POST"),
        ("POST", "/schema", {}, 405, "by GET"),
        ("GET", "/signals?names=plant.z", None, 400, "near names: plant.y"),
        ("POST", "/set", {"plant.u": [1]}, 400, "expected 2 numbers of type Float64 in N"),
        ("POST", "/set", [1], 400, "expected an object"),
        ("POST", "/step", {"steps": 1}, 400, "field 'steps' does not exist"),
        ("POST", "/step", {"values": {}}, 400, "field 'values' does not exist"),
        ("POST", "/restore", {"snapshot": "x"}, 400, "does not exist"),
        ("GET", "/live?names=plant.y&rate=1e9", None, 400, "rate"),
        ("GET", "/../../etc/passwd", None, 404, "does not exist"),
        (
            "GET",
            "/signals?name=plant.y",
            None,
            400,
            "near names: names",
        ),
        ("GET", "/signals", None, 400, "no names; expected such as"),
        ("GET", "/describe?x=1", None, 400, "expected none"),
        ("DELETE", "/set", None, 405, "expected GET or POST"),
    ],
)
def test_a_wrong_request_is_answered_in_words(
    door: HttpDoor, method: str, path: str, body: Any, status: int, words: str
) -> None:
    found, read = ask(door, method, path, body)
    assert (found, read["ok"]) == (status, False)
    assert words in read["error"]


def answers(raw: socket.socket, words: bytes) -> bool:
    """Say whether the words come; head and body may come apart."""
    answer = b""
    while words not in answer and (more := raw.recv(1 << 16)):
        answer += more
    return words in answer


def test_what_is_no_json_is_answered_in_words(door: HttpDoor) -> None:
    with socket.create_connection(("127.0.0.1", door.port), timeout=10.0) as raw:
        head = "POST /set HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        raw.sendall(f"{head}Content-Length: 2\r\n\r\n{{]".encode())
        assert answers(raw, b"not JSON")


@pytest.mark.parametrize(
    ("headers", "words"),
    [
        ({"Host": "evil.example"}, "expected localhost"),
        ({"Origin": "http://evil.example"}, "a page of http://evil.example asks"),
        ({"Content-Type": "text/plain"}, "expected application/json"),
    ],
)
def test_another_web_site_cannot_make_a_browser_step(
    door: HttpDoor, desk: FakeDesk, headers: dict[str, str], words: str
) -> None:
    status, read = ask(door, "POST", "/step", {"n": 1}, **headers)
    assert status in (403, 415)
    assert words in read["error"]
    assert desk.tick == 0


def test_a_role_allows_what_it_allows(desk: FakeDesk) -> None:
    def admit(user: str | None, password: str | None) -> frozenset[str]:
        if (user, password) != ("ann", "secret"):
            raise InputInvalid("user or password is wrong; ask who serves this co-simulation")
        return frozenset({"read"})

    code = "Basic " + base64.b64encode(b"ann:secret").decode()
    with HttpDoor(desk, 0, admit=admit) as door:
        status, read = ask(door, "GET", "/schema")
        assert status == 401
        assert "user or password is wrong" in read["error"]
        assert ask(door, "GET", "/signals?names=plant.y", Authorization=code)[0] == 200
        status, read = ask(door, "POST", "/step", {}, Authorization=code)
        assert (status, read["error"]) == (403, "step: this needs 'step'; your role may read")


def test_the_page_loads_nothing_from_elsewhere(door: HttpDoor) -> None:
    status, text = ask(door, "GET", "/")
    assert status == 200
    assert "EventSource" in text
    assert "http://" not in text
    assert "https://" not in text


def test_live_values_come_as_they_change(door: HttpDoor, desk: FakeDesk) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", door.port, timeout=10.0)
    connection.request("GET", "/live?names=plant.y&rate=50")
    answer = connection.getresponse()
    first = json.loads(answer.readline().removeprefix(b"data: "))
    assert (first["tick"], first["values"]) == (0, {"plant.y": [0.0, 0.0]})
    assert ask(door, "POST", "/step", {"inputs": {"plant.u": [1, 1]}})[0] == 200
    answer.readline()
    second = json.loads(answer.readline().removeprefix(b"data: "))
    assert second["tick"] == 1
    assert second["values"]["plant.y"][0] == pytest.approx(1 - DECAY)
    connection.close()


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"GET / HT",
        b"POST /step HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\n{",
        b"\x00" * 1000,
    ],
)
def test_a_half_open_or_malformed_client_costs_the_others_nothing(
    door: HttpDoor, data: bytes
) -> None:
    with socket.create_connection(("127.0.0.1", door.port), timeout=10.0) as raw:
        raw.sendall(data)
        assert ask(door, "POST", "/step", {})[0] == 200
        if data:
            while raw.recv(1 << 16):
                pass  # it is let go


def test_a_body_that_is_too_large_is_refused_before_it_is_read(door: HttpDoor) -> None:
    with socket.create_connection(("127.0.0.1", door.port), timeout=10.0) as raw:
        raw.sendall(b"POST /set HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999\r\n\r\n")
        assert b" 413 " in raw.recv(1 << 16)


def test_more_connections_than_may_be_are_told(door: HttpDoor) -> None:
    held = [socket.create_connection(("127.0.0.1", door.port), 10.0) for _ in range(BRIEF.clients)]
    try:
        with socket.create_connection(("127.0.0.1", door.port), timeout=10.0) as raw:
            assert answers(raw, b"4 connections are open")
    finally:
        for one in held:
            one.close()


def test_a_port_in_use_is_refused_in_words(desk: FakeDesk, door: HttpDoor) -> None:
    with pytest.raises(InputInvalid, match=rf"HTTP port {door.port} .*in use"):
        HttpDoor(desk, door.port)


def test_bytes_that_are_no_request_are_answered_in_json(door: HttpDoor) -> None:
    with socket.create_connection(("127.0.0.1", door.port), timeout=10.0) as raw:
        raw.sendall(b"nothing of HTTP/9.9 here at all\r\n\r\n")
        assert answers(raw, b'"ok": false')


def test_a_number_is_given_with_its_unit(conducted: HttpDoor) -> None:
    assert ask(conducted, "POST", "/set", {"sum.a": "7.2 km/h"})[0] == 200
    assert ask(conducted, "GET", "/signals?names=sum.a")[1]["values"] == {"sum.a": 2.0}
    status, read = ask(conducted, "POST", "/set", {"sum.a": "3 kg"})
    assert (status, "m/s" in read["error"]) == (400, True)


def test_a_role_that_may_not_set_does_not_pilot(desk: FakeDesk) -> None:
    with HttpDoor(desk, 0, admit=lambda *_: frozenset({"read"})) as door:
        status, read = ask(door, "POST", "/pilot", {"page": "mine", "axes": {}})
    assert (status, "needs 'set'" in read["error"]) == (403, True)
