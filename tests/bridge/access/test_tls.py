"""TLS and mutual TLS on every transport: one sentence answers a certificate that does not fit."""

from __future__ import annotations

import base64
import http.client
import json
import socket
import ssl
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.guarded import PASSWORDS, access_file
from uuvsim_cosim.bridge.access.access_file import read_access
from uuvsim_cosim.bridge.access.certificates import make_certificates
from uuvsim_cosim.bridge.access.tls import client_context, common_names
from uuvsim_cosim.bridge.access.transports import ServerSettings, server_settings
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.clients.client import connect
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.framing import frame
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ME = Client("me", "local")
PEM = "tls: {certificate: server.pem, key: server-key.pem%s}"
MUTUAL = ", ca: ca.pem, roles: {rov-1: controller, ground: observer}"


@dataclass
class Pki:
    folder: Path

    def client(self, name: str) -> dict[str, Path]:
        files = {"certificate": f"{name}.pem", "key": f"{name}-key.pem"}
        return {key: self.folder / file for key, file in files.items()}

    @property
    def ca(self) -> Path:
        return self.folder / "ca.pem"


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Pki:
    folder = tmp_path_factory.mktemp("pki")
    make_certificates(folder, clients=["rov-1", "ground", "unnamed"])
    return Pki(folder)


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Pki:
    folder = tmp_path_factory.mktemp("other")
    make_certificates(folder, clients=["rov-1"])
    return Pki(folder)


@dataclass
class Endpoints:
    conductor: Conductor
    zenoh: Bridge
    tcp: TcpServer
    http: HttpServer


def endpoints_of(said: ServerSettings) -> Iterator[Endpoints]:
    with (
        Conductor(System("sums", "0.1").add("sum", f"{PARTS}:Sum")) as conductor,
        Bridge(conductor, port=0, host=said.zenoh_hosts, access=said.authenticator) as bridge,
        TcpServer(conductor, 0, said.hosts, admit=said.admit, tls=said.tls) as tcp,
        HttpServer(conductor, 0, said.hosts, admit=said.admit, tls=said.tls) as http,
    ):
        yield Endpoints(conductor, bridge, tcp, http)


@pytest.fixture(scope="module")
def tls(pki: Pki) -> Iterator[Endpoints]:
    yield from endpoints_of(server_settings(access_file(pki.folder, PEM % "", users=("ann",))))


@pytest.fixture(scope="module")
def mutual(pki: Pki) -> Iterator[Endpoints]:
    yield from endpoints_of(server_settings(access_file(pki.folder, PEM % MUTUAL, users=("ann",))))


ANN: dict[str, Any] = {"user": "ann", "password": PASSWORDS["ann"]}


def at_tcp(port: int, context: ssl.SSLContext, **hello: Any) -> dict[str, Any]:
    """Say hello, and give the answer."""
    with (
        socket.create_connection(("127.0.0.1", port)) as plain,
        context.wrap_socket(plain, server_hostname="127.0.0.1") as client,
    ):
        client.sendall(frame({"call": "hello", "protocol": 1, **hello}))
        file = client.makefile("rb")
        for _ in range(2):
            size, _ = struct.unpack("<II", file.read(8))
            told: dict[str, Any] = json.loads(file.read(size))
        return told


def at_http(port: int, context: ssl.SSLContext, who: str = "") -> tuple[int, dict[str, Any]]:
    connection = http.client.HTTPSConnection("127.0.0.1", port, context=context)
    try:
        code = base64.b64encode(who.encode()).decode()
        headers = {"Authorization": f"Basic {code}"} if who else {}
        connection.request("GET", "/signals?names=sum.s", headers=headers)
        answer = connection.getresponse()
        return answer.status, json.loads(answer.read())
    finally:
        connection.close()


# ---- TLS --------------------------------------------------------------------------------------


def test_with_the_ca_and_a_password_every_endpoint_opens(tls: Endpoints, pki: Pki) -> None:
    with connect(port=tls.zenoh.port, ca=pki.ca, **ANN) as client:
        assert client.step(1) == {}
        with client.subscribe("sum") as blocks:
            tls.conductor.run(ME, None, 20.0)
            assert next(blocks).component == "sum"
            tls.conductor.pause(ME)
    context = client_context(pki.ca, None, None)
    assert at_tcp(tls.tcp.port, context, **ANN)["allowed"] == ["manage", "read", "set", "step"]
    assert at_http(tls.http.port, context, f"ann:{PASSWORDS['ann']}")[0] == 200
    assert "requires a login" in at_http(tls.http.port, context)[1]["error"]
    assert "requires a login" in at_tcp(tls.tcp.port, context)["error"]
    assert tls.http.addresses[0].startswith("https://")


def test_another_ca_is_said(tls: Endpoints, other: Pki) -> None:
    with pytest.raises(InputInvalid, match=r"not signed by the CA that is trusted here.*expected"):
        connect(port=tls.zenoh.port, ca=other.ca, **ANN)
    for port in (tls.tcp.port, tls.http.port):
        with pytest.raises(ssl.SSLCertVerificationError):
            at_tcp(port, client_context(other.ca, None, None))


def test_a_client_without_tls_is_told_to_speak_it(tls: Endpoints) -> None:
    with pytest.raises(InputInvalid, match=r"it uses TLS; expected ca="):
        connect(port=tls.zenoh.port, **ANN)
    with socket.create_connection(("127.0.0.1", tls.tcp.port)) as plain:
        plain.sendall(frame({"call": "hello", "protocol": 1}))
        assert b"this server uses TLS" in plain.recv(1 << 16)
    with socket.create_connection(("127.0.0.1", tls.tcp.port)) as silent:
        assert b"this server uses TLS" in silent.recv(1 << 16)
    with socket.create_connection(("127.0.0.1", tls.http.port)) as plain:
        plain.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert b"https://" in plain.makefile("rb").read()


def test_tls_where_nobody_speaks_it_is_said(pki: Pki) -> None:
    with (
        Bridge(System("sums", "0.1").add("sum", f"{PARTS}:Sum"), port=0) as bridge,
        pytest.raises(UuvsimError, match="it does not use TLS"),
    ):
        connect(port=bridge.port, ca=pki.ca)


@pytest.mark.parametrize(
    ("hosts", "days", "words"),
    [
        (["rov.example"], 9, r"not one of '127\.0\.0\.1'; expected to connect by a name"),
        (["127.0.0.1"], -1, "its certificate has expired; expected a new one there"),
    ],
)
def test_a_servers_certificate_that_does_not_fit_is_said(
    tmp_path: Path, hosts: list[str], days: float, words: str
) -> None:
    make_certificates(tmp_path, hosts, days=days)
    said = server_settings(access_file(tmp_path, PEM % "", users=("ann",)))
    with (
        Bridge(
            System("sums", "0.1").add("sum", f"{PARTS}:Sum"), port=0, access=said.authenticator
        ) as bridge,
        pytest.raises(InputInvalid, match=words),
    ):
        connect(port=bridge.port, ca=tmp_path / "ca.pem", **ANN)


# ---- mutual TLS -------------------------------------------------------------------------------


def test_a_certificate_has_the_role_that_the_file_says(mutual: Endpoints, pki: Pki) -> None:
    for name, allowed in (("rov-1", {"read", "set", "step"}), ("ground", {"read"})):
        shown = pki.client(name)
        with connect(port=mutual.zenoh.port, ca=pki.ca, **shown) as client:
            assert client.allowed == allowed
            if "step" not in allowed:
                with pytest.raises(InputInvalid, match="this call needs 'step'"):
                    client.step(1)
        context = client_context(pki.ca, shown["certificate"], shown["key"])
        assert set(at_tcp(mutual.tcp.port, context)["allowed"]) == allowed
        assert at_http(mutual.http.port, context)[0] == 200


def test_a_certificate_that_the_file_does_not_name_needs_a_user(
    mutual: Endpoints, pki: Pki
) -> None:
    shown = pki.client("unnamed")
    with connect(port=mutual.zenoh.port, ca=pki.ca, **shown, **ANN) as client:
        assert "manage" in client.allowed
    with pytest.raises(InputInvalid, match="requires a login"):
        connect(port=mutual.zenoh.port, ca=pki.ca, **shown)
    context = client_context(pki.ca, shown["certificate"], shown["key"])
    assert "requires a login" in at_tcp(mutual.tcp.port, context)["error"]
    status, told = at_http(mutual.http.port, context)
    assert (status, "requires a login" in told["error"]) == (401, True)


def test_nobody_joins_by_the_certificate_of_another(mutual: Endpoints, pki: Pki) -> None:
    from uuvsim_cosim.bridge.clients.access import Credentials

    session = Credentials(ca=pki.ca, **pki.client("ground")).opened("127.0.0.1", mutual.zenoh.port)
    with session:
        said = json.dumps({"client": "x"})
        assert list(session.raw.get("uuvsim/sums/certificate/rov-1", payload=said)) == []
        assert list(session.raw.get("uuvsim/sums/certificate/*", payload=said)) == []
        assert len(list(session.raw.get("uuvsim/sums/certificate/ground", payload=said))) == 1


def test_no_certificate_or_one_of_another_ca_is_said(
    mutual: Endpoints, pki: Pki, other: Pki
) -> None:
    with pytest.raises(InputInvalid, match="it requires a certificate of this client"):
        connect(port=mutual.zenoh.port, ca=pki.ca, **ANN)
    with pytest.raises(InputInvalid, match="does not know the CA of this client's certificate"):
        connect(port=mutual.zenoh.port, ca=pki.ca, **other.client("rov-1"))
    none = client_context(pki.ca, None, None)
    assert "requires a certificate" in at_tcp(mutual.tcp.port, none, **ANN)["error"]
    status, told = at_http(mutual.http.port, none, f"ann:{PASSWORDS['ann']}")
    assert (status, "requires a certificate" in told["error"]) == (401, True)
    shown = other.client("rov-1")
    wrong = client_context(pki.ca, shown["certificate"], shown["key"])
    with pytest.raises((ssl.SSLError, ConnectionError)):
        at_tcp(mutual.tcp.port, wrong)


# ---- files ------------------------------------------------------------------------------------


def test_a_key_of_another_certificate_is_said_on_both_sides(pki: Pki, tmp_path: Path) -> None:
    for name in ("server.pem", "ca.pem"):
        (tmp_path / name).write_bytes((pki.folder / name).read_bytes())
    (tmp_path / "server-key.pem").write_bytes((pki.folder / "rov-1-key.pem").read_bytes())
    with pytest.raises(InputInvalid, match=r"yaml:3: tls: the key is not that of the certificate"):
        read_access(access_file(tmp_path, PEM % "", users=("ann",)))
    with pytest.raises(InputInvalid, match="the key is not that of the certificate"):
        connect(ca=pki.ca, certificate=pki.folder / "ground.pem", key=tmp_path / "server-key.pem")


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({"ca": "none.pem"}, "ca 'none.pem': no such file"),
        ({"certificate": __file__}, "certificate and key belong together"),
        ({"ca": __file__}, "cannot be read"),
    ],
)
def test_files_that_do_not_fit_are_said(files: dict[str, str], words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        connect(**files)  # type: ignore[arg-type]


def test_names_are_read_from_a_certificate(pki: Pki) -> None:
    assert common_names(pki.folder / "rov-1.pem") == ["rov-1", "uuvsim CA"]
    assert common_names(pki.folder / "rov-1-key.pem") == []


def test_certificates_are_not_overwritten_and_keys_are_private(pki: Pki) -> None:
    with pytest.raises(InputInvalid, match=r"server\.pem exists"):
        make_certificates(pki.folder)
    with pytest.raises(InputInvalid, match=r"ground\.pem exists"):
        make_certificates(pki.folder, clients=["ground"])
    assert (pki.folder / "ca-key.pem").stat().st_mode & 0o077 == 0


def test_a_ca_signs_more_clients_later(mutual: Endpoints, pki: Pki) -> None:
    files = make_certificates(pki.folder, clients=["late"])
    assert [file.name for file in files] == ["late.pem", "late-key.pem"]
    with connect(port=mutual.zenoh.port, ca=pki.ca, **pki.client("late"), **ANN) as client:
        assert "manage" in client.allowed
