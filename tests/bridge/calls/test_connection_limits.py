"""Places: an idle client gives up its own when all are taken, once, and to one connection."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from uuvsim_cosim.bridge.calls.connection_limits import ConnectionSlots, Limits


@pytest.fixture
def sockets() -> Iterator[list[socket.socket]]:
    pairs = [socket.socketpair() for _ in range(6)]
    yield [near for near, _ in pairs]
    for pair in pairs:
        for end in pair:
            end.close()


def test_each_idle_client_makes_room_for_one(sockets: list[socket.socket]) -> None:
    slots = ConnectionSlots(Limits(clients=2, patience_s=0.0))

    def comes(k: int) -> bool:
        return slots.add(sockets[k]) and slots.admit(sockets[k])

    assert comes(0)
    assert comes(1)
    assert not comes(2)  # neither is idle
    slots.idle(sockets[0])
    assert comes(3)
    assert not comes(4)  # the idle one has gone already
    assert slots.admit(sockets[1])
    slots.idle(sockets[3])
    slots.idle(sockets[1])
    assert comes(5)  # in the place of the one that was idle for longer
    assert [slots.admit(s) for s in (sockets[1], sockets[3], sockets[5])] == [True, False, True]
