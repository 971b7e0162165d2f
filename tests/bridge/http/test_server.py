"""The HTTP endpoint: JSON there and back, a page, live values; what browsers are not made to do."""

from __future__ import annotations

import base64
import http.client
import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import uuvsim_cosim as uuv
from tests.bridge.fake_service import DECAY, STEP, FakeService
from tests.bridge.peer import bearer
from uuvsim_cosim.bridge.calls.connection_limits import Limits
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid

FEW, NO_FRAME = Limits(clients=4), Limits(frame_s=0.3)  # the short time is one claim's alone


@pytest.fixture
def service() -> FakeService:
    return FakeService()


@pytest.fixture
def endpoint(service: FakeService) -> Iterator[HttpServer]:
    with HttpServer(service, 0, limits=FEW) as opened:
        yield opened


@pytest.fixture
def conducted() -> Iterator[HttpServer]:
    sums = uuv.System("sums", "0.1").add("sum", f"{Path(__file__).parents[1] / 'parts.py'}:Sum")
    with Conductor(sums) as conductor, HttpServer(conductor, 0) as opened:
        yield opened


def ask(
    endpoint: HttpServer, method: str, path: str, body: Any = None, **headers: str
) -> tuple[int, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", endpoint.port)
    try:
        data = None if body is None else json.dumps(body).encode()
        said = {"Content-Type": "application/json"} if body is not None else {}
        connection.request(method, path, data, {**bearer(endpoint.port), **said, **headers})
        answer = connection.getresponse()
        read = answer.read()
        kind = answer.getheader("Content-Type", "")
        return answer.status, json.loads(read) if "json" in kind else read.decode()
    finally:
        connection.close()


def test_values_are_set_and_steps_made_and_outputs_given(endpoint: HttpServer) -> None:
    assert ask(endpoint, "POST", "/set", {"plant.u": [1, -2]})[0] == 200
    status, read = ask(endpoint, "POST", "/step", {"n": 3, "outputs": ["plant.y"]})
    assert (status, read["tick"], read["running"]) == (200, 3, False)
    expected = [1 - DECAY**3, -2 * (1 - DECAY**3)]
    assert read["values"]["plant.y"] == pytest.approx(expected)
    inputs = {"plant.u": [0, 0]}
    read = ask(endpoint, "POST", "/step", {"dt": STEP, "inputs": inputs, "outputs": ["plant.y"]})[1]
    assert read["values"]["plant.y"] == pytest.approx([DECAY * x for x in expected])
    values = ask(endpoint, "GET", "/signals?names=plant.y,plant.mode")[1]["values"]
    assert values == {"plant.y": read["values"]["plant.y"], "plant.mode": "free"}


def test_it_says_what_there_is(endpoint: HttpServer) -> None:
    assert ask(endpoint, "GET", "/describe")[1]["system"]["system"] == "fake"
    signals = ask(endpoint, "GET", "/schema")[1]["signals"]
    assert signals[0] == {
        "name": "plant.u",
        "type": "Float64",
        "shape": [2],
        "unit": "N",
        "causality": "input",
        "settable": True,
        "description": "force",
    }


def test_a_run_is_recorded_and_a_snapshot_restored(endpoint: HttpServer) -> None:
    kept = ask(endpoint, "POST", "/snapshot")[1]["snapshot"]
    run = {"duration": 0.05, "record": ["plant.y"]}
    first = ask(endpoint, "POST", "/run", run)[1]["values"]
    assert len(first["time"]) == len(first["plant.y"]) == 5
    assert ask(endpoint, "POST", "/restore", {"snapshot": kept})[1]["tick"] == 0
    assert ask(endpoint, "POST", "/run", run)[1]["values"] == first
    assert ask(endpoint, "POST", "/run", {"factor": 1})[1]["running"]
    assert not ask(endpoint, "POST", "/pause")[1]["running"]
    assert ask(endpoint, "POST", "/reset", {"start": {"plant.count": 9}})[1]["tick"] == 0
    assert ask(endpoint, "GET", "/signals?names=plant.count")[1]["values"]["plant.count"] == 9


@pytest.mark.parametrize(
    ("method", "path", "body", "status", "words"),
    [
        ("GET", "/descibe", None, 404, "did you mean describe"),
        ("GET", "/step", None, 405, "needs POST"),
        ("POST", "/schema", {}, 405, "needs GET"),
        ("GET", "/signals?names=plant.z", None, 400, "did you mean plant.y"),
        ("POST", "/set", {"plant.u": [1]}, 400, "1 values; expected 2 values of type Float64"),
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
            "did you mean names",
        ),
        ("GET", "/signals", None, 400, "no names; expected such as"),
        ("GET", "/describe?x=1", None, 400, "expected none"),
        ("DELETE", "/set", None, 405, "expected GET or POST"),
    ],
)
def test_a_wrong_request_is_answered_in_words(
    endpoint: HttpServer, method: str, path: str, body: Any, status: int, words: str
) -> None:
    found, read = ask(endpoint, method, path, body)
    assert (found, read["ok"]) == (status, False)
    assert words in read["error"]


def answers(raw: socket.socket, words: bytes) -> bool:
    """Return whether the words come; head and body may come apart."""
    answer = b""
    while words not in answer and (more := raw.recv(1 << 16)):
        answer += more
    return words in answer


def test_what_is_no_json_is_answered_in_words(endpoint: HttpServer) -> None:
    with socket.create_connection(("127.0.0.1", endpoint.port)) as raw:
        head = "POST /set HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        raw.sendall(f"{head}Content-Length: 2\r\n\r\n{{]".encode())
        assert answers(raw, b"not JSON")


@pytest.mark.parametrize(
    ("headers", "words"),
    [
        ({"Host": "evil.example"}, "expected localhost"),
        ({"Origin": "http://evil.example"}, "the request is from a page of http://evil.example"),
        ({"Content-Type": "text/plain"}, "expected application/json"),
    ],
)
def test_another_web_site_cannot_make_a_browser_step(
    endpoint: HttpServer, service: FakeService, headers: dict[str, str], words: str
) -> None:
    status, read = ask(endpoint, "POST", "/step", {"n": 1}, **headers)
    assert status in (403, 415)
    assert words in read["error"]
    assert service.tick == 0


def test_a_role_allows_what_it_allows(service: FakeService) -> None:
    def admit(user: str | None, password: str | None, *_: object) -> frozenset[str]:
        if (user, password) != ("ann", "secret"):
            raise InputInvalid("user or password is wrong; ask who serves this co-simulation")
        return frozenset({"read"})

    code = "Basic " + base64.b64encode(b"ann:secret").decode()
    with HttpServer(service, 0, admit=admit) as endpoint:
        status, read = ask(endpoint, "GET", "/schema")
        assert status == 401
        assert "user or password is wrong" in read["error"]
        assert ask(endpoint, "GET", "/signals?names=plant.y", Authorization=code)[0] == 200
        status, read = ask(endpoint, "POST", "/step", {}, Authorization=code)
        assert (status, read["error"]) == (403, "step: this call needs 'step'; your role may read")


def test_the_page_loads_nothing_from_elsewhere(endpoint: HttpServer) -> None:
    status, text = ask(endpoint, "GET", "/")
    assert status == 200
    assert "EventSource" in text
    assert "http://" not in text
    assert "https://" not in text


def test_live_values_come_as_they_change(endpoint: HttpServer, service: FakeService) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", endpoint.port)
    connection.request("GET", "/live?names=plant.y&rate=50", headers=bearer(endpoint.port))
    answer = connection.getresponse()
    first = json.loads(answer.readline().removeprefix(b"data: "))
    assert (first["tick"], first["values"]) == (0, {"plant.y": [0.0, 0.0]})
    assert ask(endpoint, "POST", "/step", {"inputs": {"plant.u": [1, 1]}})[0] == 200
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
    service: FakeService, data: bytes
) -> None:
    with (
        HttpServer(service, 0, limits=NO_FRAME) as endpoint,
        socket.create_connection(("127.0.0.1", endpoint.port)) as raw,
    ):
        raw.sendall(data)
        assert ask(endpoint, "POST", "/step", {})[0] == 200
        if data:
            while raw.recv(1 << 16):
                pass  # it is let go


def test_a_body_that_is_too_large_is_refused_before_it_is_read(endpoint: HttpServer) -> None:
    with socket.create_connection(("127.0.0.1", endpoint.port)) as raw:
        raw.sendall(b"POST /set HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999\r\n\r\n")
        assert answers(raw, b" 413 ")


@pytest.mark.parametrize("length", ["Content-Length: two", "Transfer-Encoding: chunked"])
def test_a_body_of_unknown_length_is_refused(
    endpoint: HttpServer, service: FakeService, length: str
) -> None:
    before = service.moment().tick
    with socket.create_connection(("127.0.0.1", endpoint.port)) as raw:
        head = f"POST /step HTTP/1.1\r\nHost: localhost\r\n{length}\r\n\r\n"
        raw.sendall(head.encode() + b"2\r\n{}\r\n0\r\n\r\n")
        assert answers(raw, b" 411 ")
    assert service.moment().tick == before


def test_a_server_that_cannot_write_its_token_leaves_its_port_free(
    service: FakeService, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: object, port: int) -> None:
        raise OSError(port, "no space left")

    monkeypatch.setattr("uuvsim_cosim.bridge.http.server.TokenFile", full)
    with pytest.raises(OSError, match="no space left") as caught:
        HttpServer(service, 0)
    monkeypatch.undo()
    with HttpServer(service, caught.value.errno or 0) as opened:  # `caught` keeps the first alive
        assert opened.port == caught.value.errno


def test_more_connections_than_may_be_are_told(endpoint: HttpServer) -> None:
    held = [http.client.HTTPConnection("127.0.0.1", endpoint.port) for _ in range(FEW.clients + 1)]
    try:
        for one in held:  # live streams, so that none is idle
            one.request("GET", "/live?names=plant.y", headers=bearer(endpoint.port))
            answer = one.getresponse()
            assert answer.status == (200 if one is not held[-1] else 503)
        assert b"4 clients are connected" in answer.read()
    finally:
        for one in held:
            one.close()


def test_a_port_in_use_is_refused_in_words(service: FakeService, endpoint: HttpServer) -> None:
    with pytest.raises(InputInvalid, match=rf"HTTP port {endpoint.port} .*in use"):
        HttpServer(service, endpoint.port)


def test_bytes_that_are_no_request_are_answered_in_json(endpoint: HttpServer) -> None:
    with socket.create_connection(("127.0.0.1", endpoint.port)) as raw:
        raw.sendall(b"nothing of HTTP/9.9 here at all\r\n\r\n")
        assert answers(raw, b'"ok": false')


def test_a_number_is_given_with_its_unit(conducted: HttpServer) -> None:
    assert ask(conducted, "POST", "/set", {"sum.a": "7.2 km/h"})[0] == 200
    assert ask(conducted, "GET", "/signals?names=sum.a")[1]["values"] == {"sum.a": 2.0}
    status, read = ask(conducted, "POST", "/set", {"sum.a": "3 kg"})
    assert (status, "m/s" in read["error"]) == (400, True)


def test_a_role_that_may_not_set_does_not_pilot(service: FakeService) -> None:
    with HttpServer(service, 0, admit=lambda *_: frozenset({"read"})) as endpoint:
        status, read = ask(endpoint, "POST", "/pilot", {"page": "mine", "axes": {}})
    assert (status, "needs 'set'" in read["error"]) == (403, True)


def test_a_large_answer_comes_in_pieces_with_the_same_values(conducted: HttpServer) -> None:
    run = {"until": 3000.0, "record": ["sum.both", "sum.s"]}
    kept = ask(conducted, "POST", "/snapshot")[1]["snapshot"]
    read = ask(conducted, "POST", "/run", run)[1]
    assert read["ok"]
    assert read["tick"] == len(read["values"]["time"]) - 1 == 30_000
    assert read["values"]["sum.both"] == [[0.0, 0.0]] * 30_001
    ask(conducted, "POST", "/restore", {"snapshot": kept})
    body = json.dumps(run).encode()
    head = (
        "POST /run HTTP/1.0\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        "Connection: keep-alive\r\n"
        + "".join(f"{k}: {v}\r\n" for k, v in bearer(conducted.port).items())
        + f"Content-Length: {len(body)}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", conducted.port)) as raw:
        # Without pieces the answer ends with the connection: the second request has no answer.
        raw.sendall(head.encode() + body + b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")
        answer = b"".join(iter(lambda: raw.recv(1 << 16), b""))
    assert b"chunked" not in answer
    assert json.loads(answer.partition(b"\r\n\r\n")[2]) == read


def test_a_run_that_is_too_large_to_answer_is_refused_at_once(conducted: HttpServer) -> None:
    status, read = ask(conducted, "POST", "/run", {"duration": 1e9, "record": ["sum.s"]})
    assert (status, "expected at most 536870912" in read["error"]) == (400, True)
    assert ask(conducted, "POST", "/step")[1]["tick"] == 1
