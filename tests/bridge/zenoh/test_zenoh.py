"""The Zenoh endpoint: its keys, its messages for clients in any language, and who is refused."""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridge.waiting import PATIENCE, until
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.zenoh import session as session_module
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.zenoh.codec import error_of, message_of, packed, read_message, unpacked
from uuvsim_cosim.bridge.zenoh.session import WrappedSession, connecting, free_port, listening
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, Problem, SystemInvalid, UuvsimError
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")


@pytest.fixture(scope="module")
def bridge() -> Iterator[Bridge]:
    system = System("sums", "0.1").add("sum", f"{PARTS}:Sum")
    with Bridge(system, port=0, anyone=True) as bridge:  # the messages, not who may send them
        yield bridge


@pytest.fixture
def session(bridge: Bridge) -> Iterator[WrappedSession]:
    bridge.conductor.reset(ME)
    with connecting("127.0.0.1", bridge.port) as session:
        yield session


def asked(session: WrappedSession, call: str, message: Any = None, block: bytes = b"") -> Any:
    payload = message if isinstance(message, bytes) else json.dumps(message or {})
    asker = session.asker(f"uuvsim/sums/call/{call}")
    reply = next(iter(asker.get(payload=payload, attachment=block or None)))
    if reply.ok is None:
        return json.loads(reply.err.payload.to_bytes())
    return json.loads(reply.ok.payload.to_bytes())


# ---- messages ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "value",
    [1.5, 3, True, "text", np.arange(6.0).reshape(2, 3), np.array([True, False]), np.zeros(0)],
)
def test_a_packed_value_is_unpacked_as_it_was(value: Any) -> None:
    held, block = packed({"before": np.arange(3), "it": value})
    given = unpacked(json.loads(json.dumps(held)), block)["it"]
    assert np.array_equal(given, value)
    assert np.shape(given) == np.shape(value)


@pytest.mark.parametrize(
    "held",
    [
        {"at": 0, "type": "f8", "shape": [9]},
        {"at": -8, "type": "f8", "shape": [1]},
        {"at": 0, "type": "O", "shape": [1]},
        {"at": 0, "type": "f8", "shape": [-1]},
        {"at": 0, "type": "f8", "shape": [2**40, 2**40]},
        {"at": "0", "type": "f8", "shape": 1},
        {},
    ],
)
def test_numbers_that_do_not_lie_in_the_block_are_refused(held: Any) -> None:
    with pytest.raises(InputInvalid, match="numbers that lie in the block"):
        unpacked({"x": held}, bytes(16))


@pytest.mark.parametrize("data", [b"{", b"[]", b"\xff\xfe", b"7", b"[" * 100_000])
def test_what_is_no_object_of_json_is_refused(data: bytes) -> None:
    with pytest.raises(InputInvalid, match="expected a JSON object"):
        read_message(data)


@pytest.mark.parametrize(
    "error",
    [
        InputInvalid("no"),
        ComponentFailed("hull", 1.5, "capsized"),
        SystemInvalid([Problem("a", "b", "c")]),
        ZeroDivisionError("by zero"),
    ],
)
def test_an_error_arrives_in_its_words(error: BaseException) -> None:
    told = error_of(json.loads(json.dumps(message_of(error))))
    assert isinstance(told, UuvsimError)
    assert str(error) in str(told)


# ---- keys -------------------------------------------------------------------------------------


def test_json_alone_is_enough_to_step(session: WrappedSession) -> None:
    message = {"n": 5, "inputs": {"sum.a": 2.0}, "outputs": ["sum.s", "sum.both"]}
    told = asked(session, "step", message)
    assert told["moment"] == {"tick": 5, "time": 0.5, "running": False}
    assert told["values"]["sum.s"] == pytest.approx(1.0)
    assert told["values"]["sum.both"] == [2.0, 0.0]


def test_a_block_is_read_by_the_schema(session: WrappedSession, bridge: Bridge) -> None:
    schema = asked(session, "schema")
    assert schema["blocks"] == {"sum": ["sum.s", "sum.both"]}
    subscriber = session.subscribe("uuvsim/sums/state/sum", 16)
    assert bridge.stream.wait_until_wanted("sum", timeout=PATIENCE)
    blocks: list[bytes] = []

    def has_block() -> bool:
        sample = subscriber.try_recv()
        blocks.extend([] if sample is None else [sample.payload.to_bytes()])
        return bool(blocks)

    # A block may be dropped where the network is busy: later ones follow.
    until(has_block, lambda: bridge.conductor.step(ME, 1, {"sum.a": 4.0, "sum.b": 5.0}))
    tick, at, layout = struct.unpack("<qdq", blocks[0][:24])
    assert (at, layout) == (pytest.approx(0.1 * tick), schema["layout"])
    values = np.frombuffer(blocks[0], "<f8", offset=24)
    assert values == pytest.approx([0.9 * tick, 4.0, 5.0])


def test_components_and_clients_are_seen_to_live(session: WrappedSession, bridge: Bridge) -> None:
    with connect(port=bridge.port):

        def clients() -> list[str]:
            return session.alive("uuvsim/sums/live/client/*")

        until(lambda: len(clients()) == 1)  # one that has left is noticed a little later
        keys = session.alive("uuvsim/sums/live/**")
        assert {k.rpartition("/live/")[2] for k in keys if k not in clients()} == {
            "master",
            "component/sum",
        }


@pytest.mark.parametrize(
    ("call", "message", "words"),
    [
        ("stpe", {}, "step"),
        ("step", b"{nonsense", "JSON object"),
        ("get", {"names": 3}, "list of names"),
        ("get", {"names": ["sum.z"]}, "sum.s"),
        ("step", {"n": "many"}, "whole number"),
        ("step", {"inputs": [1, 2]}, "object of names"),
        ("step", {"inputs": {"sum.a": {"at": 0, "type": "f8", "shape": [3]}}}, "lie in the block"),
        ("run", {"until": "noon"}, "a number"),
        ("run", {"until": 1.0, "factor": -1.0}, "more than 0"),
        ("set", {"values": {"sum.a": None}}, "sum.a"),
        ("restore", {"snapshot": 7}, "the name of a snapshot"),
        ("replace", {"component": "sum", "source": "no.fmu"}, "no such file"),
        ("replace", {"component": "smu", "source": "no.fmu"}, "sum"),
        ("reset", {"seed": "x"}, "whole number"),
        ("step", {"client": "nobody"}, "not joined"),
        ("join", {"protocol": 99, "version": "9.9", "client": "x"}, "uses protocol 99"),
        ("join", {"client": ""}, "an id of its own"),
        ("join", {"client": "x", "lockstep": True, "lag": -1}, "more than 0"),
    ],
)
def test_a_wrong_call_is_answered_in_words_and_nothing_moves(
    session: WrappedSession, bridge: Bridge, call: str, message: Any, words: str
) -> None:
    told = asked(session, call, message)
    assert words in told["message"]
    assert bridge.conductor.moment().tick == 0
    assert asked(session, "get", {"names": ["sum.a"]})["values"] == {"sum.a": 0.0}


def test_what_is_not_finite_is_null_in_json_alone(session: WrappedSession, bridge: Bridge) -> None:
    from uuvsim_cosim.bridge.calls.values import json_of

    told = json.dumps(json_of({"x": np.array([1.0, np.nan, np.inf])}), allow_nan=False)
    assert json.loads(told) == {"x": [1.0, None, None]}


# ---- listening --------------------------------------------------------------------------------


def test_a_port_in_use_is_said_to_be(bridge: Bridge) -> None:
    with pytest.raises(InputInvalid, match=f"port {bridge.port} .* is in use"):
        listening(bridge.port)


def test_any_free_port_is_another_one_where_the_first_was_taken_meanwhile(
    bridge: Bridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = iter([bridge.port, bridge.port, free_port("127.0.0.1")])
    monkeypatch.setattr(session_module, "free_port", lambda host: next(found))
    with listening(0) as other:
        assert other.port not in (0, bridge.port)
        with connecting("127.0.0.1", other.port) as client:
            assert client.is_connected


def test_only_this_machine_is_listened_to(bridge: Bridge) -> None:
    addresses = {i[4][0] for i in socket.getaddrinfo(socket.gethostname(), None)}
    for address in addresses - {"127.0.0.1", "::1"}:
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        with socket.socket(family) as s:
            s.settimeout(1.0)
            assert s.connect_ex((address, bridge.port)) != 0


def test_bytes_that_are_no_zenoh_change_nothing(bridge: Bridge) -> None:
    for noise in (b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 4096, b""):
        with socket.create_connection(("127.0.0.1", bridge.port)) as s:
            s.sendall(noise)
    with connect(port=bridge.port) as client:
        assert client.step(outputs=["sum.both"])["sum.both"].tolist() == [0.0, 0.0]


# ---- ending -----------------------------------------------------------------------------------

_OPEN = """
import sys, threading
from uuvsim_cosim.bridge.zenoh.session import connecting
session = connecting("127.0.0.1", int(sys.argv[1]))
subscriber = session.raw.declare_subscriber("uuvsim/**", lambda sample: None)
waiting = threading.Thread(target=session.subscribe("nothing", 1).recv)
waiting.start()
print("at the end")
"""


def test_a_program_ends_though_a_session_with_a_callback_is_open(bridge: Bridge) -> None:
    done = _program(_OPEN, bridge.port)
    assert done.stdout.strip() == "at the end"
    assert done.returncode == 0


_SERVING = """
import sys
import threading
import time
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.orchestrator.system.system import System
bridge = Bridge(System("sums", "0.1").add("sum", sys.argv[1] + ":Sum"), port=0, record=sys.argv[2])
client = connect(port=bridge.port)
subscription = client.subscribe("sum.s")
client.run()
next(subscription)
print("at the end")
"""


def test_a_program_that_serves_and_streams_ends_with_its_recording(tmp_path: Path) -> None:
    done = _program(_SERVING, PARTS, tmp_path / "run")
    assert done.stdout.strip() == "at the end", done.stderr
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "run" / "signals.parquet").is_file()


def _program(text: str, *arguments: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", text, *map(str, arguments)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
