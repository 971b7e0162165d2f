"""A connection from outside of a cluster, of which the head loses what would answer it."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from uuvsim_cosim.cluster import address as cluster_address
from uuvsim_cosim.errors import InputInvalid

SAID = """Initialization failure from server:
Traceback (most recent call last):
  File "proxier.py", line 771, in Datapath
    raise RuntimeError(
RuntimeError: Starting Ray client server failed. See ray_client_server_23000.err for detailed logs.
"""
REFUSED = "Initialization failure from server:\nThe client is of another namespace."


class Head(ModuleType):
    """In place of Ray: a head that fails so often, as it says."""

    def __init__(self, fails: int, says: str) -> None:
        super().__init__("ray")
        self.fails, self.says, self.asked = fails, says, 0

    def is_initialized(self) -> bool:
        return False

    def init(self, **_: Any) -> None:
        self.asked += 1
        if self.asked <= self.fails:
            raise ConnectionAbortedError(self.says)


def connected(head: Head, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", head)
    monkeypatch.setattr(cluster_address, "_answered", lambda address: None)
    monkeypatch.setattr(cluster_address, "_silenced", lambda ray: lambda: None)
    cluster_address.connect("ray://10.0.0.7:10001")


@pytest.mark.parametrize("fails", [0, 1, 2])
def test_a_head_that_lost_its_process_is_asked_again(
    fails: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = Head(fails, SAID)
    connected(head, monkeypatch)
    assert head.asked == fails + 1


def test_after_three_times_the_heads_own_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    head = Head(9, SAID)
    with pytest.raises(InputInvalid, match=r"ray://10.0.0.7:10001: RuntimeError: Starting Ray"):
        connected(head, monkeypatch)
    assert head.asked == 3


def test_a_refusal_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    head = Head(9, REFUSED)
    with pytest.raises(InputInvalid, match="10001: The client is of another namespace; expected"):
        connected(head, monkeypatch)
    assert head.asked == 1


def test_a_local_cluster_leaves_the_settings_of_ray_as_they_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", "/mine")
    monkeypatch.delenv("RAY_AUTH_TOKEN", raising=False)
    names = ("MODE", "TOKEN", "TOKEN_PATH")
    before = [os.environ.get(f"RAY_AUTH_{name}") for name in names]
    guard = cluster_address._Guard()
    assert os.environ["RAY_AUTH_MODE"] == "token"
    assert "RAY_AUTH_TOKEN_PATH" not in os.environ
    folder = Path(guard.folder).parent
    assert folder.stat().st_mode & 0o777 == 0o700
    guard.end()
    assert [os.environ.get(f"RAY_AUTH_{name}") for name in names] == before
    assert not folder.exists()
