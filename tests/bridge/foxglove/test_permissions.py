"""Addresses, TLS and permissions of Foxglove's clients, which cannot log in."""

from __future__ import annotations

from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from tests.bridge.foxglove.client import connected
from tests.bridge.guarded import access_file
from uuvsim_cosim.bridge.access.certificates import make_certificates
from uuvsim_cosim.bridge.access.tls import client_context
from uuvsim_cosim.bridge.access.transports import server_settings
from uuvsim_cosim.bridge.foxglove.permissions import foxglove_permissions
from uuvsim_cosim.bridge.foxglove.server import FoxgloveServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid

PARTS = Path(__file__).parents[1] / "parts.py"
EVERY = {"read", "set", "step"}
PEM = "tls: {certificate: server.pem, key: server-key.pem%s}"


def test_without_access_file_this_machine_may_read() -> None:
    """A page in a browser of this machine reaches the port, whatever its origin."""
    given = foxglove_permissions(server_settings())
    assert given.hosts == ("127.0.0.1",)
    assert given.allowed == {"read"}
    assert "--anyone" in given.reason


def test_anyone_may_step_but_not_load_code() -> None:
    given = foxglove_permissions(server_settings(anyone=True))
    assert given.hosts == ("127.0.0.1",)
    assert given.allowed == EVERY


def test_another_machine_needs_anyone_or_an_access_file() -> None:
    with pytest.raises(InputInvalid, match=r"0\.0\.0\.0 is reachable from other machines"):
        foxglove_permissions(server_settings(None, ["0.0.0.0"]))
    given = foxglove_permissions(server_settings(None, ["0.0.0.0"], anyone=True))
    assert given.allowed == EVERY


def test_with_an_access_file_clients_may_only_read_and_the_reason_is_given(tmp_path: Path) -> None:
    given = foxglove_permissions(server_settings(access_file(tmp_path)))
    assert given.allowed == {"read"}
    assert given.reason == "Foxglove's clients cannot log in; with --access they may only read"


def test_other_machines_read_only_what_the_access_file_lets_others_read(tmp_path: Path) -> None:
    closed = access_file(tmp_path, "tls: none", "listen: 0.0.0.0")
    with pytest.raises(InputInvalid, match="does not let others read; expected an address of this"):
        foxglove_permissions(server_settings(closed))
    opened = access_file(tmp_path, "tls: none", "listen: 0.0.0.0", "anyone: owner")
    assert foxglove_permissions(server_settings(opened)).allowed == {"read"}


def test_tls_of_the_access_file_is_used_and_mutual_tls_is_refused(tmp_path: Path) -> None:
    make_certificates(tmp_path)
    lines = ("listen: 0.0.0.0", "anyone: observer")
    mutual = access_file(tmp_path, PEM % ", ca: ca.pem", *lines)
    with pytest.raises(InputInvalid, match="requires certificates of clients"):
        foxglove_permissions(server_settings(mutual))
    given = foxglove_permissions(server_settings(access_file(tmp_path, PEM % "", *lines)))
    with (
        Conductor(uuv.System("sums", "0.1").add("a", f"{PARTS}:Sum")) as conductor,
        FoxgloveServer(conductor, 0, given) as server,
    ):
        assert server.addresses == (f"wss://0.0.0.0:{server.port}",)
        context = client_context(tmp_path / "ca.pem", None, None)
        with connected(server.port, ssl=context) as client:
            assert client.parameters() == {"a.k": 1.0}


def test_several_addresses_have_one_port_and_the_same_channels() -> None:
    given = foxglove_permissions(server_settings(None, ["127.0.0.1", "127.0.0.2"]))
    with (
        Conductor(uuv.System("sums", "0.1").add("a", f"{PARTS}:Sum")) as conductor,
        FoxgloveServer(conductor, 0, given) as server,
        connected(server.port) as client,
    ):
        assert len(server.addresses) == 2
        assert {a.rpartition(":")[2] for a in server.addresses} == {str(server.port)}
        assert "/a" in client.advertised(2)
