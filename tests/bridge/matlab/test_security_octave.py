"""The MATLAB client, run in Octave, says who it is, and why it may not enter."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bridge.guarded import PASSWORDS, access_file
from tests.bridge.in_octave import NEEDS_OCTAVE, said
from uuvsim_cosim.bridge.access.certificates import make_certificates
from uuvsim_cosim.bridge.access.transports import server_settings
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
pytestmark = NEEDS_OCTAVE


@pytest.fixture
def ports(tmp_path: Path) -> Iterator[tuple[int, int]]:
    make_certificates(tmp_path)
    plain = server_settings(access_file(tmp_path, users=("bob",)))
    lines = "tls: {certificate: server.pem, key: server-key.pem}"
    tls = server_settings(access_file(tmp_path, lines, users=("bob",)))
    with (
        Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as conductor,
        TcpServer(conductor, 0, admit=plain.admit) as endpoint,
        TcpServer(conductor, 0, admit=tls.admit, tls=tls.tls) as secured,
    ):
        yield endpoint.port, secured.port


def test_octave_enters_with_a_password_and_is_refused_in_words(ports: tuple[int, int]) -> None:
    known = f"'user', 'bob', 'password', '{PASSWORDS['bob']}'"
    lines = said(
        f"s = uuvsim.connect('port', {ports[0]}, {known}); disp(strjoin(s.allowed)); "
        "try, s.step([], 0.1); catch e, disp(e.message); end; "
        f"try, uuvsim.connect('port', {ports[0]}); catch e, disp(e.message); end; "
        f"try, uuvsim.connect('port', {ports[1]}, {known}); catch e, disp(e.message); end"
    ).splitlines()
    assert lines[0] == "read"
    assert "this call needs 'step'" in lines[1]
    assert lines[2] == "uuvsim: this co-simulation requires a login; expected user and password"
    assert lines[3].startswith("uuvsim: this server uses TLS")
