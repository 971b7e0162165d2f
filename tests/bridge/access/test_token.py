"""A server asks for a token that only programs of the same user can read."""

from __future__ import annotations

import http.client
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import uuvsim_cosim as uuv
from tests.bridge.peer import Peer
from uuvsim_cosim.bridge.access.authentication import everybody
from uuvsim_cosim.bridge.access.token import (
    TokenFile,
    guarded_by_token,
    known_token,
    token_file,
    token_folder,
)
from uuvsim_cosim.bridge.access.zenoh_permissions import GUEST, client_settings
from uuvsim_cosim.bridge.clients.remote import serve_component, source
from uuvsim_cosim.bridge.http.server import HttpServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.tcp.server import TcpServer
from uuvsim_cosim.bridge.zenoh.bridge import Bridge
from uuvsim_cosim.bridge.zenoh.session import Disconnected, connecting
from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.orchestrator.system.system import System

PARTS = Path(__file__).parents[1] / "parts.py"
ASKS = "this co-simulation requires a token. Programs of the server's user find it in "
WRONG = "the token is wrong. Programs of the server's user find it in "


@dataclass
class Endpoints:
    zenoh: Bridge
    tcp: TcpServer
    http: HttpServer

    @property
    def ports(self) -> tuple[int, int, int]:
        return self.zenoh.port, self.tcp.port, self.http.port


def sums() -> System:
    return System("sums", "0.1").add("sum", f"{PARTS}:Sum")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("UUVSIM_TOKENS", str(tmp_path / "tokens"))
    monkeypatch.delenv("UUVSIM_TOKEN", raising=False)
    return tmp_path / "tokens"


@pytest.fixture
def endpoints(folder: Path) -> Iterator[Endpoints]:
    authenticator = guarded_by_token()
    with (
        Conductor(sums()) as conductor,
        Bridge(conductor, port=0, access=authenticator) as bridge,
        TcpServer(conductor, 0, admit=authenticator) as tcp,
        HttpServer(conductor, 0, admit=authenticator) as http_,
    ):
        yield Endpoints(bridge, tcp, http_)


# ---- one way to ask at each transport, with any token; each gives the words of the refusal, or ""

REPLACE = {"component": "sum", "source": ""}


def at_zenoh(endpoints: Endpoints, token: str, call: str, said: dict[str, Any]) -> str:
    try:
        with uuv.connect(port=endpoints.zenoh.port, token=token) as client:
            client._ask(call, **said)
    except UuvsimError as error:
        return str(error)
    return ""


def at_zenoh_without_joining(
    endpoints: Endpoints, token: str, call: str, said: dict[str, Any]
) -> str:
    port = endpoints.zenoh.port
    opening = known_token("127.0.0.1", port)
    with connecting("127.0.0.1", port, client_settings(GUEST, opening)) as session:
        message = json.dumps({**said, "token": token} if token else said)
        reply = next(iter(session.raw.get(f"uuvsim/sums/call/{call}", payload=message)))
        return "" if reply.ok is not None else str(json.loads(reply.err.payload.to_bytes()))


def at_tcp(endpoints: Endpoints, token: str, call: str, said: dict[str, Any]) -> str:
    with Peer(endpoints.tcp.port, token=token) as peer:
        told = peer.welcome
        if told["ok"]:
            told = peer.ask({"call": call, **said})[0]
        return "" if told["ok"] else str(told["error"])


def over_http(
    endpoints: Endpoints, method: str, path: str, body: Any = None, **headers: str
) -> tuple[http.client.HTTPResponse, str]:
    connection = http.client.HTTPConnection("127.0.0.1", endpoints.http.port)
    try:
        given = {"Content-Type": "application/json"} | {
            key.replace("_", "-"): value for key, value in headers.items()
        }
        connection.request(method, path, None if body is None else json.dumps(body), given)
        answer = connection.getresponse()
        return answer, answer.read().decode()
    finally:
        connection.close()


def at_http(endpoints: Endpoints, token: str, call: str, said: dict[str, Any]) -> str:
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    answer, text = over_http(endpoints, "POST", f"/{call}", said, **headers)
    told = json.loads(text)
    assert (answer.status == 401) == (ASKS in text or WRONG in text)
    return "" if told["ok"] else str(told["error"])


QuerySender = Callable[[Endpoints, str, str, dict[str, Any]], str]
EVERY = pytest.mark.parametrize("ask", [at_zenoh, at_zenoh_without_joining, at_tcp, at_http])


@EVERY
def test_without_the_token_nothing_is_answered_and_where_it_is_is_said(
    endpoints: Endpoints, folder: Path, ask: QuerySender
) -> None:
    calls = {
        at_zenoh: ("step",),  # refused before any call, which takes two seconds
        at_http: ("step", "replace"),  # the others are asked for by GET
    }
    for call in calls.get(ask, ("describe", "get", "step", "replace")):
        for token, words in (("", ASKS), ("x" * 43, WRONG)):
            said = ask(endpoints, token, call, {})
            if ask is at_zenoh:
                assert "opens no session to this client: the server requires a" in said
                assert f"Programs of the server's user find the token in {folder}" in said
            else:
                assert f"{words}{folder}" in said


def test_no_session_is_opened_without_the_token(endpoints: Endpoints) -> None:
    for password in (GUEST, "", "x" * 43):
        with pytest.raises(Disconnected):
            connecting("127.0.0.1", endpoints.zenoh.port, client_settings(GUEST, password))
    with uuv.connect(port=endpoints.zenoh.port) as client:
        client.step(1)


@EVERY
def test_no_code_is_loaded_for_a_client_without_the_token(
    endpoints: Endpoints, tmp_path: Path, ask: QuerySender
) -> None:
    mark = tmp_path / "was_here"
    (tmp_path / "evil.py").write_text(f"import pathlib; pathlib.Path({str(mark)!r}).touch()\n")
    said = {"component": "sum", "source": f"{tmp_path / 'evil.py'}:E"}
    for token in ("", "x" * 43):
        assert "token" in ask(endpoints, token, "replace", said)
    assert not mark.exists()
    assert "no class" in ask(
        endpoints, str(known_token("127.0.0.1", endpoints.ports[0])), "replace", said
    )
    assert mark.exists()  # the file is one that would have told


@EVERY
def test_with_the_token_a_client_is_the_owner(endpoints: Endpoints, ask: QuerySender) -> None:
    token = known_token("127.0.0.1", endpoints.tcp.port)
    assert token is not None
    assert ask(endpoints, token, "step", {}) == ""
    assert ask(endpoints, token, "replace", {"component": "sum", "source": f"{PARTS}:Sum"}) == ""


@pytest.mark.parametrize(
    "path", ["/describe", "/schema", "/signals?names=sum.s", "/live", "/pilots"]
)
def test_nothing_is_read_over_http_without_the_token(endpoints: Endpoints, path: str) -> None:
    answer, text = over_http(endpoints, "GET", path)
    assert answer.status == 401
    assert answer.getheader("WWW-Authenticate") == 'Bearer realm="uuvsim"'
    assert ASKS in text


def test_little_is_read_of_who_has_not_shown_the_token(endpoints: Endpoints) -> None:
    long = "x" * 100_000
    with Peer(endpoints.tcp.port, name=long, token="") as peer:
        assert "expected at most 65536" in peer.welcome["error"]
    with socket.create_connection(("127.0.0.1", endpoints.http.port)) as raw:
        raw.sendall(b"POST /set HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100000\r\n\r\n")
        assert b" 401 " in raw.recv(1 << 16)  # though nothing of the body has come
    token = str(known_token("127.0.0.1", endpoints.ports[0]))
    with Peer(endpoints.tcp.port) as peer:
        assert "no signal" in peer.ask({"call": "get", "names": [long]})[0]["error"]
    assert "component" in at_http(endpoints, token, "replace", {"component": long, "source": "x"})


# ---- the file ---------------------------------------------------------------------------------


def test_the_file_is_for_its_user_alone_and_goes_with_the_server(folder: Path) -> None:
    with Bridge(sums(), port=0) as bridge:
        file = token_file(bridge.port)
        assert file.parent == folder
        assert file.stat().st_mode & 0o777 == 0o600
        assert folder.stat().st_mode & 0o777 == 0o700
        assert list(folder.iterdir()) == [file]
        with uuv.connect(port=bridge.port) as client:
            assert client.allowed == {"read", "set", "step", "manage"}
    assert list(folder.iterdir()) == []


def test_each_server_has_a_token_of_its_own(folder: Path) -> None:
    with Bridge(sums(), port=0) as one, Bridge(sums(), port=0) as other:
        tokens = {known_token("127.0.0.1", bridge.port) for bridge in (one, other)}
    assert len(tokens) == 2
    assert all(token is not None and len(token) >= 43 for token in tokens)


def test_a_link_in_the_files_place_is_replaced_and_not_followed(
    folder: Path, tmp_path: Path
) -> None:
    folder.mkdir(mode=0o700)
    other = tmp_path / "others"
    other.write_text("kept")
    token_file(4711).symlink_to(other)
    with TokenFile(guarded_by_token(), 4711):
        assert other.read_text() == "kept"
        assert not token_file(4711).is_symlink()


@pytest.mark.parametrize("spoil", ["link", "mode", "owner", "text", "fifo"])
def test_a_client_takes_no_token_that_others_may_know_or_have_made(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: str
) -> None:
    with TokenFile(guarded_by_token(), 4711):
        file = token_file(4711)
        if spoil == "link":
            file.rename(tmp_path / "kept")
            file.symlink_to(tmp_path / "kept")
        elif spoil == "mode":
            file.chmod(0o640)
        elif spoil == "owner":
            monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
        elif spoil == "text":
            file.write_text("-----BEGIN OPENSSH PRIVATE KEY-----")
        else:
            file.unlink()
            os.mkfifo(file, 0o600)
        with pytest.raises(InputInvalid, match=r"expected (a f|a file written by a server)"):
            known_token("127.0.0.1", 4711)


def test_a_folder_that_others_may_enter_is_refused(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    folder.chmod(0o755)
    with pytest.raises(InputInvalid, match=r"its mode 755 gives other users access.*mode 700"):
        Bridge(sums(), port=0)
    with pytest.raises(InputInvalid, match="its mode 755"):
        known_token("127.0.0.1", 4711)


def test_a_folder_that_is_a_link_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "others").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "others")
    with pytest.raises(InputInvalid, match="it is a link"):
        TcpServer(None, 0)  # type: ignore[arg-type]


def test_a_server_removes_no_token_of_another(folder: Path) -> None:
    with TokenFile(guarded_by_token(), 4711):
        other = TokenFile(guarded_by_token(), 4711)
        kept = known_token("127.0.0.1", 4711)
    assert known_token("127.0.0.1", 4711) == kept
    other.close()
    assert known_token("127.0.0.1", 4711) is None


def test_a_forked_child_leaves_the_file(folder: Path) -> None:
    with TokenFile(guarded_by_token(), 4711) as file:
        child = os.fork()
        if child == 0:
            file.close()
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        assert token_file(4711).exists()


def test_a_token_is_not_shown_to_a_server_on_another_machine(folder: Path) -> None:
    with TokenFile(guarded_by_token(), 4711):
        for host in ("192.0.2.7", "rov.local", "0.0.0.0"):
            assert known_token(host, 4711) is None


def test_the_environment_gives_the_token(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UUVSIM_TOKEN", "0123456789abcdef")
    assert known_token("192.0.2.7", 4711) == "0123456789abcdef"
    assert guarded_by_token().access.token == "0123456789abcdef"
    monkeypatch.setenv("UUVSIM_TOKEN", "too short")
    with pytest.raises(InputInvalid, match="UUVSIM_TOKEN has 9 characters; expected 16 to 200"):
        guarded_by_token()


def test_without_a_home_directory_the_folder_must_be_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UUVSIM_TOKENS", "tokens")
    with pytest.raises(InputInvalid, match="expected the environment variable UUVSIM_TOKENS"):
        token_folder()
    with pytest.raises(InputInvalid, match="expected the environment variable UUVSIM_TOKENS"):
        Bridge(sums(), port=0)
    with Bridge(sums(), port=0, anyone=True) as bridge, uuv.connect(port=bridge.port) as client:
        client.step(1)


def test_a_server_for_anyone_writes_no_file(folder: Path) -> None:
    with Bridge(sums(), port=0, anyone=True) as bridge, uuv.connect(port=bridge.port) as client:
        client.step(1)
        with (
            TcpServer(bridge.conductor, 0, admit=everybody) as endpoint,
            Peer(endpoint.port) as peer,
        ):
            assert peer.welcome["ok"]
    assert not folder.exists()


# ---- pages ------------------------------------------------------------------------------------


def entered(endpoints: Endpoints) -> str:
    """Open the page by its address with the token, and give the cookie."""
    token = known_token("127.0.0.1", endpoints.http.port)
    answer, _ = over_http(endpoints, "GET", f"/pilot?token={token}")
    assert (answer.status, answer.getheader("Location")) == (303, "/pilot")
    cookie, *rules = str(answer.getheader("Set-Cookie")).split("; ")
    assert {"HttpOnly", "SameSite=Lax"} <= set(rules)
    assert str(token) not in cookie
    return cookie


def test_a_page_is_opened_by_an_address_with_the_token_once(endpoints: Endpoints) -> None:
    cookie = entered(endpoints)
    for path in ("/", "/pilot", "/schema"):
        answer, text = over_http(endpoints, "GET", path, Cookie=f"theme=dark; a={{1}}; {cookie}")
        assert (answer.status, "EventSource" in text) == (200, path == "/")
        assert answer.getheader("X-Frame-Options") == "DENY"
    answer, _ = over_http(endpoints, "POST", "/step", {}, Cookie=cookie)
    assert answer.status == 200


@pytest.mark.parametrize("path", ["/", "/pilot", "/?token=wrong", "/pilot?token=%3Cscript%3E"])
def test_a_page_without_the_token_says_where_it_is(
    endpoints: Endpoints, folder: Path, path: str
) -> None:
    answer, text = over_http(endpoints, "GET", path)
    assert answer.status == 401
    assert str(folder) in text
    assert "EventSource" not in text
    assert "<script" not in text
    assert answer.getheader("Set-Cookie") is None


def test_a_token_in_an_address_opens_no_more_than_pages(endpoints: Endpoints) -> None:
    token = known_token("127.0.0.1", endpoints.http.port)
    assert over_http(endpoints, "GET", f"/schema?token={token}")[0].status in (400, 401)
    assert over_http(endpoints, "POST", f"/step?token={token}", {})[0].status == 401


def test_a_cookie_of_another_server_opens_nothing(endpoints: Endpoints) -> None:
    cookie = entered(endpoints)
    with Conductor(sums()) as conductor, HttpServer(conductor, 0) as other:
        elsewhere = Endpoints(endpoints.zenoh, endpoints.tcp, other)
        renamed = f"uuvsim-{other.port}={cookie.partition('=')[2]}"
        for shown in (cookie, renamed):
            assert over_http(elsewhere, "GET", "/schema", Cookie=shown)[0].status == 401


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "http://127.0.0.1:9999"},
        {"Origin": "null"},
        {"Host": "evil.example"},
        {"Content_Type": "text/plain"},
    ],
)
def test_a_page_of_another_site_cannot_use_the_cookie(
    endpoints: Endpoints, headers: dict[str, str]
) -> None:
    cookie = entered(endpoints)
    answer, _ = over_http(endpoints, "POST", "/step", {"n": 1}, Cookie=cookie, **headers)
    assert answer.status in (403, 415)
    assert endpoints.zenoh.conductor.moment().tick == 0


# ---- components elsewhere ---------------------------------------------------------------------


def test_a_component_is_served_to_masters_with_the_token(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with serve_component(f"{PARTS}:Sum", "sum", port=0) as server:
        assert source(server.source, tmp_path).describe().name == "Sum"
        monkeypatch.setenv("UUVSIM_TOKENS", str(tmp_path / "none"))
        with pytest.raises(InputInvalid, match="requires a token"):
            source(server.source, tmp_path).describe()
        monkeypatch.setenv("UUVSIM_TOKENS", str(folder))
        with pytest.raises(Disconnected):
            connecting("127.0.0.1", server.port, client_settings(GUEST, GUEST))
        token = known_token("127.0.0.1", server.port)
        settings = client_settings(GUEST, token)
        with (
            connecting("127.0.0.1", server.port, settings) as session,
            connecting("127.0.0.1", server.port, settings) as listener,
        ):
            heard: list[Any] = []
            listener.answer("uuvsim-component/**", heard.append)
            for call in ("instantiate", "step", "set_state", "free"):
                message = json.dumps({"path": "x", "instance": 1})
                key = f"uuvsim-component/sum/{call}"
                reply = next(iter(session.raw.get(key, payload=message)))
                assert reply.ok is None
                assert "token" in (said := reply.err.payload.to_string()) or "no instance" in said
        assert heard == []
    with serve_component(f"{PARTS}:Sum", "sum", port=0, anyone=True) as server:
        assert source(server.source, tmp_path).describe().name == "Sum"


# ---- the commands -----------------------------------------------------------------------------


def served(folder: Path, *options: str) -> Iterator[list[str]]:
    """Serve in a process of its own, and give the lines that it printed first."""
    command = [sys.executable, "-m", "uuvsim_cosim", "serve", "sums.ssd", "--paused", "--no-record"]
    ports = ("--port", "0", "--tcp-port", "0", "--http-port", "0")
    with subprocess.Popen(
        [*command, *ports, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        lines = []
        while "Ctrl-C ends it" not in (line := process.stdout.readline()):
            assert line, lines
            lines.append(line.rstrip())
        try:
            yield lines
        finally:
            process.send_signal(signal.SIGTERM)


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    sums().write(tmp_path / "sums.ssd")


def port_in(lines: list[str], what: str) -> int:
    return int(next(one for one in lines if what in one).split()[1].strip("/,").rpartition(":")[2])


def test_a_log_does_not_hold_the_token(
    folder: Path, system: None, capsys: pytest.CaptureFixture[str]
) -> None:
    for lines in served(folder):
        port = port_in(lines, "HTTP")
        token = known_token("127.0.0.1", port)
        assert token is not None
        assert token not in "\n".join(lines)
        assert any("uuvsim access token" in line for line in lines)
        assert status_of(["access", "token", "--port", str(port)]) == 0
        assert capsys.readouterr().out.strip() == token
        assert status_of(["access", "token", "--port", str(port), "--header"]) == 0
        assert capsys.readouterr().out == f"Authorization: Bearer {token}\n"
    assert list(folder.iterdir()) == []
    assert status_of(["access", "token", "--port", str(port)]) == 2
    assert "none of your servers uses a token there" in capsys.readouterr().err


def test_serving_anyone_is_warned_of(folder: Path, system: None) -> None:
    for lines in served(folder, "--anyone"):
        assert "--anyone: everybody who reaches these ports may do everything" in "\n".join(lines)
        with Peer(port_in(lines, "TCP")) as peer:
            assert peer.welcome["allowed"] == ["manage", "read", "set", "step"]
    assert not folder.exists()


def test_loading_code_can_be_disabled_for_owners_too(folder: Path, system: None) -> None:
    for lines in served(folder, "--no-code"):
        with Peer(port_in(lines, "TCP")) as peer:
            told, _ = peer.ask({"call": "replace", "component": "sum", "source": f"{PARTS}:Sum"})
            assert "this server loads no code for its clients (--no-code)" in told["error"]
            assert peer.ask({"call": "step"})[0]["ok"]
