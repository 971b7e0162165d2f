"""HTTP clients hold the lockstep barrier: they join, wait for each other, and may be lost."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.desk import Client
from uuvsim_cosim.bridge.http_door import HttpDoor
from uuvsim_cosim.bridge.http_sessions import HEADER, IDLE, SESSIONS, Sessions
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system import System

PARTS = Path(__file__).parent / "parts.py"
ME = Client("me", "local")


@pytest.fixture
def desk() -> Iterator[Conductor]:
    with Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as desk:
        yield desk


@pytest.fixture
def door(desk: Conductor) -> Iterator[HttpDoor]:
    with HttpDoor(desk, 0, ("127.0.0.1",)) as door:
        yield door


def post(door: HttpDoor, path: str, said: Any = None, session: str | None = None) -> Any:
    link = http.client.HTTPConnection("127.0.0.1", door.port, timeout=30.0)
    headers = {"Content-Type": "application/json"}
    if session is not None:
        headers[HEADER] = session
    link.request("POST", path, json.dumps(said or {}), headers)
    answer = json.loads(link.getresponse().read())
    link.close()
    return answer


def joined(door: HttpDoor, name: str, **said: Any) -> str:
    return str(post(door, "/join", {"name": name, "lockstep": True, **said})["session"])


def test_two_http_clients_step_as_one(door: HttpDoor, desk: Conductor) -> None:
    one, two = joined(door, "one"), joined(door, "two")
    assert desk.describe()["mode"] == "lockstep"
    with ThreadPoolExecutor(2) as both:
        first = both.submit(post, door, "/step", {"n": 2, "inputs": {"sum.a": 1.0}}, one)
        assert not first.done()
        second = both.submit(
            post, door, "/step", {"n": 2, "inputs": {"sum.b": 2.0}, "outputs": ["sum.s"]}, two
        )
        assert (first.result(30)["tick"], second.result(30)["tick"]) == (2, 2)
    assert second.result()["values"]["sum.s"] == pytest.approx(0.6)


def test_an_http_client_waits_for_one_of_another_door(door: HttpDoor, desk: Conductor) -> None:
    web, other = joined(door, "web"), desk.join(ME, lockstep=True, lag=30.0)
    with ThreadPoolExecutor(1) as aside:
        asked = aside.submit(post, door, "/step", {"n": 1}, web)
        assert desk.step(other)[0].tick == 1
        assert asked.result(30)["tick"] == 1
    post(door, "/leave", None, web)
    assert desk.step(other, 3)[0].tick == 4


def test_who_does_not_hold_the_barrier_does_not_move_time(door: HttpDoor) -> None:
    joined(door, "holder")
    refused = post(door, "/step", {"n": 1})
    assert not refused["ok"]
    assert "holder" in refused["error"]


def test_a_client_that_is_late_is_dropped_and_told(door: HttpDoor) -> None:
    late, other = joined(door, "late", lag=0.05), joined(door, "other", lag=30.0)
    assert post(door, "/step", {"n": 1}, other)["tick"] == 1
    assert "was dropped from lockstep" in post(door, "/step", {"n": 1}, late)["error"]


def test_a_session_that_is_not_is_refused(door: HttpDoor) -> None:
    assert "is not known here" in post(door, "/step", {"n": 1}, "wrong")["error"]
    token = joined(door, "gone")
    post(door, "/leave", None, token)
    assert "is not known here" in post(door, "/step", {"n": 1}, token)["error"]
    assert "expected the header" in post(door, "/leave")["error"]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"lag": -1}, "lag -1; expected seconds"),
        ({"lag": "soon"}, "lag 'soon'; expected seconds"),
        ({"lockstep": "yes"}, "expected true or false"),
        ({"name": ""}, "expected a text"),
        ({"nam": "a"}, "field 'nam'; expected some of name"),
    ],
)
def test_a_wrong_join_is_refused_in_words(door: HttpDoor, said: Any, words: str) -> None:
    assert words in post(door, "/join", said)["error"]


def test_a_silent_session_is_lost_and_the_others_go_on(desk: Conductor) -> None:
    now = [0.0]
    sessions = Sessions(desk, clock=lambda: now[0])
    asking = Client("http", "http")
    silent = sessions.join(asking, {"name": "silent", "lockstep": True})["session"]
    now[0] = IDLE - 1.0
    kept = sessions.join(asking, {"name": "kept", "lockstep": True})["session"]
    now[0] = IDLE + 1.0
    calls = sessions.calls(kept, asking.allowed)
    assert desk.step(calls.client)[0].tick == 1
    with pytest.raises(InputInvalid, match="is not known here, or has ended"):
        sessions.calls(silent, asking.allowed)


def test_a_session_is_not_anothers(desk: Conductor) -> None:
    sessions = Sessions(desk)
    token = sessions.join(Client("http", "http"), {})["session"]
    with pytest.raises(InputInvalid, match="from the same user"):
        sessions.calls(token, frozenset({"read"}))
    for _ in range(SESSIONS - 1):
        sessions.join(Client("http", "http"), {})
    with pytest.raises(InputInvalid, match="which is all that may be"):
        sessions.join(Client("http", "http"), {})
    sessions.close()
    assert desk.describe()["clients"] == []
