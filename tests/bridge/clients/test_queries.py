"""A client's memory does not grow with its calls, however long a call may take."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.clients import queries
from uuvsim_cosim.bridge.clients.access import Credentials
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.zenoh.session import Disconnected, WrappedSession
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
FEW = 10


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    with Bridge(System("sums", "0.1").add("sum", f"{PARTS}:Sum"), port=0) as bridge:
        yield bridge


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[WrappedSession]:
    """Return the sessions that clients open, each of which carries few calls."""
    monkeypatch.setattr(queries, "CALLS_OF_A_SESSION", FEW)
    sessions: list[WrappedSession] = []
    before = Credentials.opened

    def counted(self: Credentials, *arguments: object) -> WrappedSession:
        sessions.append(before(self, *arguments))  # type: ignore[arg-type]
        return sessions[-1]

    monkeypatch.setattr(Credentials, "opened", counted)
    return sessions


def test_a_session_carries_a_bounded_number_of_calls(
    bridge: Bridge, opened: list[WrappedSession]
) -> None:
    with uuv.connect(port=bridge.port) as client:
        for k in range(5 * FEW):
            client.step(1)
            assert client.tick == k + 1
            assert sum(session.is_open for session in opened) <= 2
    assert len(opened) == 6  # 51 calls, for joining is one
    assert not any(session.is_open for session in opened)


def test_a_call_under_way_keeps_its_session_until_it_is_answered(
    bridge: Bridge, opened: list[WrappedSession]
) -> None:
    with uuv.connect(port=bridge.port) as client:
        for _ in range(FEW):
            client.get("sum.s")  # from now on another session
        running = threading.Thread(target=lambda: client.run(until=1e7))
        running.start()
        while not bridge.conductor.moment().running:
            client.get("sum.s")
        for _ in range(3 * FEW):
            client.get("sum.s")
        assert opened[1].is_open
        client.pause()
        running.join()
        assert not opened[1].is_open


def test_a_server_that_is_gone_is_told_when_a_session_is_renewed(
    bridge: Bridge, opened: list[WrappedSession]
) -> None:
    with uuv.connect(port=bridge.port) as client:
        for _ in range(FEW - 1):
            client.step(1)
        bridge.close()
        with pytest.raises(Disconnected):
            client.step(1)


_CALLS = """
import sys
import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.clients import queries
queries.CALLS_OF_A_SESSION = 500
def bytes_held():
    return int(open("/proc/self/statm").read().split()[1]) * 4096
with uuv.connect(port=int(sys.argv[1])) as client:
    for _ in range(2000):
        client.step(1)
    before = bytes_held()
    for _ in range(6000):
        client.step(1)
    print((bytes_held() - before) / 6000)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="no /proc: memory is not known")
def test_a_call_leaves_no_memory_behind(bridge: Bridge) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _CALLS, str(bridge.port)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 250.0  # bytes; 1,100 where a session is not renewed
