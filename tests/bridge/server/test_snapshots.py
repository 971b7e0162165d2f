"""Snapshots by name: which one makes room, and the reason that its client reads."""

from __future__ import annotations

import pytest

from uuvsim_cosim.bridge.server.snapshots import ALL, EACH, Snapshots
from uuvsim_cosim.errors import InputInvalid


def test_the_oldest_snapshot_of_a_client_that_has_left_makes_room_and_the_reason_is_known() -> None:
    kept = Snapshots()
    for k in range(ALL):
        kept.add(k, f"client {k // EACH}")
    with pytest.raises(InputInvalid, match=f"all clients together keep {ALL} snapshots"):
        kept.check("another")
    kept.client_left("client 1")
    kept.check("another")
    assert kept.add("new", "another") == f"s{ALL + 1}"
    with pytest.raises(InputInvalid, match=f"'s{EACH + 1}', which .* to keep at most {ALL}"):
        kept.find(f"s{EACH + 1}")
    assert kept.find(f"s{EACH + 2}") == EACH + 1
    kept.discard(f"s{EACH + 3}")
    with pytest.raises(InputInvalid, match=f"'s{EACH + 3}', which was discarded;"):
        kept.find(f"s{EACH + 3}")
