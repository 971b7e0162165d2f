"""HTTP clients hold the lockstep barrier: they join, wait for each other, and may be lost."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.peer import bearer
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.http.sessions import HEADER, IDLE, SESSIONS, Sessions
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")


@pytest.fixture
def service() -> Iterator[Conductor]:
    with Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as service:
        yield service


@pytest.fixture
def endpoint(service: Conductor) -> Iterator[HttpServer]:
    with HttpServer(service, 0, ("127.0.0.1",)) as endpoint:
        yield endpoint


def post(endpoint: HttpServer, path: str, said: Any = None, session: str | None = None) -> Any:
    link = http.client.HTTPConnection("127.0.0.1", endpoint.port)
    headers = {"Content-Type": "application/json", **bearer(endpoint.port)}
    if session is not None:
        headers[HEADER] = session
    link.request("POST", path, json.dumps(said or {}), headers)
    answer = json.loads(link.getresponse().read())
    link.close()
    return answer


def joined(endpoint: HttpServer, name: str, **said: Any) -> str:
    return str(
        post(endpoint, "/join", {"name": name, "lockstep": True, "lag": 60.0, **said})["session"]
    )


def test_two_http_clients_step_as_one(endpoint: HttpServer, service: Conductor) -> None:
    one, two = joined(endpoint, "one"), joined(endpoint, "two")
    assert service.describe()["mode"] == "lockstep"
    with ThreadPoolExecutor(2) as both:
        first = both.submit(post, endpoint, "/step", {"n": 2, "inputs": {"sum.a": 1.0}}, one)
        assert not first.done()
        second = both.submit(
            post, endpoint, "/step", {"n": 2, "inputs": {"sum.b": 2.0}, "outputs": ["sum.s"]}, two
        )
        assert (first.result()["tick"], second.result()["tick"]) == (2, 2)
    assert second.result()["values"]["sum.s"] == pytest.approx(0.6)


def test_an_http_client_waits_for_one_of_another_endpoint(
    endpoint: HttpServer, service: Conductor
) -> None:
    web, other = joined(endpoint, "web"), service.join(ME, lockstep=True, lag=60.0)
    with ThreadPoolExecutor(1) as aside:
        asked = aside.submit(post, endpoint, "/step", {"n": 1}, web)
        assert service.step(other)[0].tick == 1
        assert asked.result()["tick"] == 1
    post(endpoint, "/leave", None, web)
    assert service.step(other, 3)[0].tick == 4


def test_who_does_not_hold_the_barrier_does_not_move_time(endpoint: HttpServer) -> None:
    joined(endpoint, "holder")
    refused = post(endpoint, "/step", {"n": 1})
    assert not refused["ok"]
    assert "holder" in refused["error"]


def test_a_client_that_is_late_is_dropped_and_told(endpoint: HttpServer) -> None:
    late, other = joined(endpoint, "late", lag=0.05), joined(endpoint, "other", lag=60.0)
    assert post(endpoint, "/step", {"n": 1}, other)["tick"] == 1
    assert "was removed from lockstep" in post(endpoint, "/step", {"n": 1}, late)["error"]


def test_a_session_that_is_not_is_refused(endpoint: HttpServer) -> None:
    assert "is unknown or has ended" in post(endpoint, "/step", {"n": 1}, "wrong")["error"]
    token = joined(endpoint, "gone")
    post(endpoint, "/leave", None, token)
    assert "is unknown or has ended" in post(endpoint, "/step", {"n": 1}, token)["error"]
    assert "expected the header" in post(endpoint, "/leave")["error"]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"lag": -1}, "lag -1 was read; expected seconds"),
        ({"lag": "soon"}, "lag 'soon' was read; expected seconds"),
        ({"lockstep": "yes"}, "expected true or false"),
        ({"name": ""}, "expected a text"),
        ({"nam": "a"}, "field 'nam' does not exist (did you mean name"),
    ],
)
def test_a_wrong_join_is_refused_in_words(endpoint: HttpServer, said: Any, words: str) -> None:
    assert words in post(endpoint, "/join", said)["error"]


def test_a_silent_session_is_lost_and_the_others_go_on(service: Conductor) -> None:
    now = [0.0]
    sessions = Sessions(service, clock=lambda: now[0])
    asking = Client("http", "http")
    silent = sessions.join(asking, {"name": "silent", "lockstep": True})["session"]
    now[0] = IDLE - 1.0
    kept = sessions.join(asking, {"name": "kept", "lockstep": True})["session"]
    now[0] = IDLE + 1.0
    calls = sessions.calls(kept, asking.allowed)
    assert service.step(calls.client)[0].tick == 1
    with pytest.raises(InputInvalid, match="is unknown or has ended"):
        sessions.calls(silent, asking.allowed)


def test_a_session_is_not_anothers(service: Conductor) -> None:
    sessions = Sessions(service)
    token = sessions.join(Client("http", "http"), {})["session"]
    with pytest.raises(InputInvalid, match="to the same user"):
        sessions.calls(token, frozenset({"read"}))
    for _ in range(SESSIONS - 1):
        sessions.join(Client("http", "http"), {})
    with pytest.raises(InputInvalid, match="the maximum"):
        sessions.join(Client("http", "http"), {})
    sessions.close()
    assert service.describe()["clients"] == []
