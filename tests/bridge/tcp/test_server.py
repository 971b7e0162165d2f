"""The TCP endpoint: right calls are carried out, and wrong clients cost the others nothing."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.bridge.fake_service import DECAY, STEP, FakeService
from tests.bridge.peer import Peer
from uuvsim_cosim.bridge.calls.connection_limits import Limits
from uuvsim_cosim.bridge.tcp.framing import frame
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.errors import InputInvalid

FEW = Limits(clients=4)
NO_HELLO, NO_FRAME = Limits(hello_s=0.3), Limits(frame_s=0.3)  # short times are these claims' alone


@pytest.fixture
def service() -> FakeService:
    return FakeService()


@pytest.fixture
def endpoint(service: FakeService) -> Iterator[TcpServer]:
    with TcpServer(service, 0, limits=FEW) as opened:
        yield opened


def works(endpoint: TcpServer) -> bool:
    """Tell whether a right client is served."""
    with Peer(endpoint.port) as peer:
        before = peer.ask({"call": "describe"})[0]["tick"]
        return bool(peer.ask({"call": "step", "n": 2})[0]["tick"] == before + 2)


def test_it_listens_on_loopback_only_on_both_kinds_of_address(endpoint: TcpServer) -> None:
    assert endpoint.addresses[0] == f"127.0.0.1:{endpoint.port}"
    assert set(endpoint.addresses) <= {f"127.0.0.1:{endpoint.port}", f"[::1]:{endpoint.port}"}
    if len(endpoint.addresses) == 2:
        with Peer(endpoint.port, "::1") as peer:
            assert peer.welcome["ok"]


def test_the_greeting_says_version_and_protocol(endpoint: TcpServer) -> None:
    with Peer(endpoint.port) as peer:
        assert peer.greeting["protocol"] == 1
        assert peer.greeting["uuvsim"]
        assert peer.welcome["step_size"] == STEP
        assert peer.welcome["allowed"] == ["manage", "read", "set", "step"]


def test_values_are_set_and_steps_made_and_outputs_given(endpoint: TcpServer) -> None:
    with Peer(endpoint.port) as peer:
        peer.ask({"call": "set", "columns": [{"name": "plant.u"}]}, [1.0, -2.0])
        header, numbers = peer.ask({"call": "step", "dt": 3 * STEP, "outputs": ["plant.y"]})
        assert (header["tick"], header["time"]) == (3, pytest.approx(3 * STEP))
        assert header["columns"] == [{"name": "plant.y", "type": "Float64", "shape": [2]}]
        assert numbers == pytest.approx((1 - DECAY**3) * np.array([1.0, -2.0]))


def test_the_compact_step_gives_the_bits_of_the_step_with_names(endpoint: TcpServer) -> None:
    with Peer(endpoint.port) as peer:
        columns = [{"name": "plant.u"}]
        asked = {"call": "step", "n": 5, "outputs": ["plant.y"], "columns": columns}
        _, first = peer.ask(asked, [0.3, 0.7])
        peer.ask({"call": "reset"})
        agreed, _ = peer.ask({"call": "layout", "inputs": ["plant.u"], "outputs": ["plant.y"]})
        assert agreed["inputs"] == [{"name": "plant.u", "type": "Float64", "shape": [2]}]
        header, second = peer.ask(None, [5, 0.3, 0.7])
        assert not header
        assert second.tolist() == [5.0, 5 * STEP, *first.tolist()]


def test_a_layout_may_name_an_output_twice(endpoint: TcpServer) -> None:
    with Peer(endpoint.port) as peer:
        peer.ask({"call": "layout", "inputs": [], "outputs": ["plant.y", "plant.y"]})
        peer.ask({"call": "set", "values": {"plant.u": [1, 2]}})
        numbers = peer.ask(None, [1])[1]
        assert len(numbers) == 6
        assert numbers[2:4].tolist() == numbers[4:].tolist() != [0.0, 0.0]


def test_a_snapshot_is_restored_and_a_run_recorded(endpoint: TcpServer) -> None:
    with Peer(endpoint.port) as peer:
        peer.ask({"call": "set", "values": {"plant.u": [1, 1], "plant.mode": "held"}})
        kept = peer.ask({"call": "snapshot"})[0]["snapshot"]
        run = {"call": "run", "duration": 0.1, "record": ["plant.y"]}
        header, first = peer.ask(run)
        assert [column["shape"] for column in header["columns"]] == [[10], [10, 2]]
        peer.ask({"call": "restore", "snapshot": kept})
        assert np.array_equal(peer.ask(run)[1], first)
        header, numbers = peer.ask({"call": "get", "names": ["plant.mode", "plant.on"]})
        assert header["texts"] == [{"name": "plant.mode", "value": "held"}]
        assert numbers.tolist() == [1.0]


@pytest.mark.parametrize(
    ("request_", "numbers", "words"),
    [
        ({"call": "stpe"}, [], "did you mean step"),
        ({"call": "step", "steps": 3}, [], "field 'steps' does not exist"),
        ({"call": "step", "n": 1.5}, [], "whole number"),
        ({"call": "step", "n": 1, "dt": 0.1}, [], "one of them"),
        ({"call": "step", "dt": 0.013}, [], "whole multiple"),
        ({"call": "get", "names": ["plant.z"]}, [], "did you mean plant.y"),
        ({"call": "get", "names": 3}, [], "list of names"),
        ({"call": "get", "columns": [{"name": "plant.u"}]}, [1, 2], "only set, step and reset"),
        ({"call": "set", "columns": [{"name": "plant.y"}]}, [1, 2], "is an output"),
        ({"call": "set", "columns": [{"name": "plant.u"}]}, [1, np.nan], "nan; expected"),
        ({"call": "set"}, [1.0], "without columns"),
        ({"call": "run", "record": ["plant.yy"], "until": 1}, [], "did you mean plant.y"),
        ({"call": "restore", "snapshot": "x"}, [], "does not exist"),
        ({"call": "layout", "inputs": ["plant.mode"]}, [], "expected numbers"),
        ({"call": ["a"]}, [], "does not exist"),
        (None, [1.0], "ask for a layout first"),
    ],
)
def test_a_wrong_call_is_answered_in_words_and_the_connection_stays(
    endpoint: TcpServer, request_: Any, numbers: Any, words: str
) -> None:
    with Peer(endpoint.port) as peer:
        header, _ = peer.ask(request_, numbers)
        assert not header["ok"]
        assert words in header["error"]
        assert peer.ask({"call": "step"})[0]["ok"]


@pytest.mark.parametrize(
    ("numbers", "words"),
    [([1, 2.0], "the layout has 2: plant.u"), ([np.nan, 1, 1], "n = nan"), ([-1, 1, 1], "n = -1")],
)
def test_a_wrong_compact_step_is_answered_in_words(
    endpoint: TcpServer, numbers: list[float], words: str
) -> None:
    with Peer(endpoint.port) as peer:
        peer.ask({"call": "layout", "inputs": ["plant.u"], "outputs": []})
        assert words in peer.ask(None, numbers)[0]["error"]
        assert peer.ask(None, [1, 0, 0])[1].tolist() == [1.0, STEP]


def test_another_protocol_is_refused_with_what_to_do(endpoint: TcpServer) -> None:
    with Peer(endpoint.port, protocol=99) as peer:
        assert "uuvsim matlab" in peer.welcome["error"]
        assert peer.ended()


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        struct.pack("<II", 3, 0) + b"nul",
        struct.pack("<II", 0xFFFFFFFF, 0xFFFFFFFF),
        frame({"call": "step"}),
        bytes(range(256)) * 400,
    ],
)
def test_a_malformed_client_is_told_and_let_go(endpoint: TcpServer, data: bytes) -> None:
    with Peer(endpoint.port, call=None) as peer:
        peer.socket.sendall(data)
        assert peer.ended() or peer.ended()  # after the words
    assert works(endpoint)


def test_a_client_that_never_says_who_it_is_is_let_go(service: FakeService) -> None:
    with (
        TcpServer(service, 0, limits=NO_HELLO) as endpoint,
        Peer(endpoint.port, call=None) as peer,
    ):
        header, _ = peer.answer()
        assert "within the time" in header["error"]
        assert peer.ended()


def test_half_a_frame_holds_its_place_for_a_bounded_time(service: FakeService) -> None:
    with TcpServer(service, 0, limits=NO_FRAME) as endpoint, Peer(endpoint.port) as peer:
        peer.socket.sendall(struct.pack("<II", 100, 0) + b"{")
        assert works(endpoint)
        assert "whole frame" in peer.answer()[0]["error"]
        assert peer.ended()


def test_more_clients_than_may_be_are_told_and_a_place_is_free_again(endpoint: TcpServer) -> None:
    peers = [Peer(endpoint.port) for _ in range(FEW.clients)]
    try:
        with Peer(endpoint.port, call=None) as one_more:
            assert "4 clients are connected" in one_more.greeting["error"]
        assert peers[0].ask({"call": "step"})[0]["ok"]
        peers[1].ask({"call": "bye"})
        assert peers[1].ended()
    finally:
        for peer in peers:
            peer.socket.close()


def test_a_client_that_does_not_read_is_let_go_and_others_are_served(
    service: FakeService,
) -> None:
    with (
        TcpServer(service, 0, limits=NO_FRAME) as endpoint,
        Peer(endpoint.port, name="slow") as peer,
        Peer(endpoint.port) as other,
    ):
        peer.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        peer.socket.setblocking(False)
        flood = frame({"call": "schema"}) * 2000
        try:
            for _ in range(500):
                peer.socket.send(flood)
        except OSError:
            pass  # its buffers are full, or it was let go
        while "slow" not in service.left:  # and nothing of all that is ever read
            assert other.ask({"call": "step"})[0]["ok"]


def test_a_client_that_dies_leaves_the_service(endpoint: TcpServer, service: FakeService) -> None:
    with Peer(endpoint.port) as peer:
        linger = struct.pack("ii", 1, 0)
        peer.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
    assert works(endpoint)
    endpoint.close()
    assert not service.clients
    assert service.left == ["peer", "peer"]


def test_a_role_allows_what_it_allows(service: FakeService) -> None:
    def admit(user: str | None, password: str | None, *_: object) -> frozenset[str]:
        if (user, password) != ("ann", "secret"):
            raise InputInvalid("user or password is wrong; ask who serves this co-simulation")
        return frozenset({"read"})

    with TcpServer(service, 0, admit=admit) as endpoint:
        with Peer(endpoint.port) as refused:
            assert "user or password is wrong" in refused.welcome["error"]
            assert refused.ended()
        with Peer(endpoint.port, user="ann", password="secret") as peer:
            assert peer.ask({"call": "get", "names": ["plant.y"]})[0]["ok"]
            assert "this call needs 'step'" in peer.ask({"call": "step"})[0]["error"]


def test_a_port_in_use_is_refused_in_words(service: FakeService, endpoint: TcpServer) -> None:
    with pytest.raises(InputInvalid, match=rf"port {endpoint.port} at 127\.0\.0\.1.*in use"):
        TcpServer(service, endpoint.port)


def test_an_end_of_the_endpoint_ends_its_clients(service: FakeService) -> None:
    endpoint = TcpServer(service, 0)
    with Peer(endpoint.port) as peer:
        endpoint.close()
        assert peer.ended()
    assert not service.clients


def test_a_mistake_of_ours_is_answered_and_the_connection_stays(
    service: FakeService, endpoint: TcpServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(*_: object) -> str:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr(service, "snapshot", wrong)
    with Peer(endpoint.port) as peer:
        assert "please report it" in peer.ask({"call": "snapshot"})[0]["error"]
        assert peer.ask({"call": "step"})[0]["ok"]
