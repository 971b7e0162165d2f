"""One request over HTTP is answered: which path is which call, and who may ask for it."""

from __future__ import annotations

import base64
import binascii
import json
import socket
import threading
import time
from collections.abc import Mapping
from functools import partial
from http.server import BaseHTTPRequestHandler
from typing import Any
from urllib.parse import parse_qs, urlsplit

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access_doorkeeper import Admission
from uuvsim_cosim.bridge.access_tls import common_name
from uuvsim_cosim.bridge.desk import Client, Desk
from uuvsim_cosim.bridge.http_pilot import pilot_page, pilots, steered
from uuvsim_cosim.bridge.http_sessions import HEADER, Sessions
from uuvsim_cosim.bridge.page import page
from uuvsim_cosim.bridge.roles import NEEDS
from uuvsim_cosim.bridge.tcp_door import hung_up
from uuvsim_cosim.bridge.wire import Disconnected, Limits
from uuvsim_cosim.bridge.wire_calls import Calls, failure
from uuvsim_cosim.bridge.wire_values import json_of, near, taken
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["Door", "Handler"]

GET = ("describe", "schema", "signals", "live", "pilots")
POST = (
    "set", "step", "run", "pause", "reset", "snapshot", "restore", "replace", "join", "leave",
    "pilot",
)  # fmt: skip
STREAMS = 8
RATE_MAX = 50.0  # Hz, of live values
_QUERY = {"signals": ("names",), "live": ("names", "rate")}
_VALUES = {"step": "inputs", "reset": "start"}  # the field that holds values, by call


class Door:
    """What all connections of one HTTP door share."""

    def __init__(self, desk: Desk, admit: Admission, limits: Limits, *, local: bool) -> None:
        self.desk = desk
        self.admit = admit
        self.limits = limits
        self.local = local  # reached by loopback only
        self.closed = threading.Event()
        self.lock = threading.Lock()
        self.open: set[socket.socket] = set()
        self.silent: dict[socket.socket, float] = {}  # whose request is not whole, and since when
        self.streams = threading.BoundedSemaphore(STREAMS)
        self.sessions = Sessions(desk)


class _Refused(Exception):
    """An answer with another status than 400."""

    def __init__(self, status: int, words: str) -> None:
        self.status = status
        super().__init__(words)


class Handler(BaseHTTPRequestHandler):
    """Answers what one connection asks for."""

    door: Door
    protocol_version = "HTTP/1.1"
    server_version = f"uuvsim-cosim/{__version__}"
    sys_version = ""
    _allowance: float = 1.0
    _last: float = 0.0
    _calls: Calls | None = None

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: observers exist."""

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse what is no request of this door in JSON, as all else."""
        self.close_connection = True
        kinds = "; expected GET or POST" if code == 501 else "; expected a request of HTTP/1.1"
        self._send(405 if code == 501 else code, b"application/json", _words(f"{message}{kinds}"))

    def do_GET(self) -> None:
        """Answer a GET: the page, or what changes nothing."""
        parts = urlsplit(self.path)
        if parts.path in ("/", "/index.html"):
            self._answered(lambda: (b"text/html; charset=utf-8", page().encode()))
            return
        if parts.path == "/pilot":
            self._answered(lambda: (b"text/html; charset=utf-8", pilot_page().encode()))
            return
        self._answered(lambda: self._read(parts.path.strip("/"), parse_qs(parts.query)))

    def do_POST(self) -> None:
        """Answer a POST: a call with a JSON object as body."""
        body = b""
        try:
            body = self._body()
        except _Refused as refused:
            self.close_connection = True
            self._send(refused.status, b"application/json", _words(str(refused)))
            return
        token = self.headers.get(HEADER)
        self.door.sessions.waiting(token, begins=True)
        try:
            self._answered(lambda: self._called(urlsplit(self.path).path.strip("/"), body))
        finally:
            self.door.sessions.waiting(token, begins=False)

    def _body(self) -> bytes:
        length = self.headers.get("Content-Length", "0")
        if not length.isascii() or not length.isdigit() or "Transfer-Encoding" in self.headers:
            raise _Refused(411, "the body's length must be said in Content-Length")
        if int(length) > self.door.limits.payload_bytes:
            most = self.door.limits.payload_bytes
            raise _Refused(413, f"a body of {length} bytes was announced; at most {most} are read")
        return self.rfile.read(int(length))

    def _answered(self, answer: Any) -> None:
        with self.door.lock:
            self.door.silent.pop(self.connection, None)
        self._wait_for_its_turn()
        try:
            self._check_origin()
            found = answer()
            if found is not None:
                self._send(200, *found)
        except _Refused as refused:
            self._send(refused.status, b"application/json", _words(str(refused)))
        except Disconnected as error:
            raise ConnectionAbortedError(str(error)) from None
        except UuvsimError as error:
            self._send(400, b"application/json", json.dumps(failure(error)).encode())
        except (OSError, TimeoutError):
            raise
        except Exception as error:  # a mistake of ours must not take the others down
            self._send(500, b"application/json", json.dumps(failure(error)).encode())

    def _wait_for_its_turn(self) -> None:
        rate, now = self.door.limits.calls_per_s, time.monotonic()
        self._allowance = min(self._allowance + (now - self._last) * rate, rate) - 1
        self._last = now
        if self._allowance < 0:
            time.sleep(-self._allowance / rate)

    def _check_origin(self) -> None:
        """Refuse what other web sites make a browser ask for (forged and rebound requests)."""
        host = self.headers.get("Host", "")
        name = host.rsplit(":", 1)[0] if not host.endswith("]") else host
        if self.door.local and name not in ("localhost", "127.0.0.1", "[::1]"):
            raise _Refused(403, f"host {host!r} was asked for; expected localhost or 127.0.0.1")
        origin = self.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            raise _Refused(403, f"a page of {origin} asks; expected one of http://{host}")

    def _allowed(self) -> tuple[str | None, frozenset[str]]:
        """Give who asks and what it may do."""
        user = password = None
        kind, _, code = self.headers.get("Authorization", "").partition(" ")
        if kind.lower() == "basic":
            try:
                user, _, password = base64.b64decode(code, validate=True).decode().partition(":")
            except (binascii.Error, UnicodeDecodeError):
                raise _Refused(400, "Authorization: expected Basic, in base64") from None
        try:
            name = common_name(self.connection)
            shown = () if name is None else (name,)
            return user, self.door.admit(user, password, *shown)
        except UuvsimError as error:
            raise _Refused(401, str(error)) from None

    def _client(self, call: str) -> Calls:
        user, allowed = self._allowed()
        self._needs(call, NEEDS.get(call), allowed)
        token = self.headers.get(HEADER)
        if token is not None:
            calls = self.door.sessions.calls(token, allowed)
            calls.attended(partial(hung_up, self.connection))
            return calls
        if self._calls is None or self._calls.client.allowed != allowed:
            self._calls = Calls(self.door.desk, Client(user or "http", "http", allowed))
            self._calls.attended(partial(hung_up, self.connection))
        return self._calls

    def _needs(self, call: str, needed: str | None, allowed: frozenset[str]) -> None:
        if needed is not None and needed not in allowed:
            may = ", ".join(sorted(allowed)) or "nothing"
            raise _Refused(403, f"{call}: this needs {needed!r}; your role may {may}")

    def _read(self, path: str, query: dict[str, list[str]]) -> tuple[bytes, bytes] | None:
        if path not in GET:
            raise _Refused(405 if path in POST else 404, _no_path(path, "GET"))
        known = _QUERY.get(path, ())
        for field in query:
            if field not in known:
                raise InputInvalid(
                    f"/{path}: query {field!r} does not exist{near(field, known)}; "
                    f"expected {' and '.join(known) or 'none'}"
                )
        names = [n for value in query.get("names", []) for n in value.split(",") if n]
        calls = self._client("get" if path in ("signals", "live") else path)
        if path == "live":
            self._live(calls, names, query)
            return None
        if path == "signals":
            if not names:
                raise InputInvalid("/signals: no names; expected such as /signals?names=hull.eta")
            return _json(calls, {"call": "get", "names": names}, {})
        if path == "pilots":
            return b"application/json", json.dumps({"ok": True, **pilots(calls.desk)}).encode()
        return _json(calls, {"call": path}, {})

    def _called(self, path: str, body: bytes) -> tuple[bytes, bytes]:
        if path not in POST:
            raise _Refused(405 if path in (*GET, "") else 404, _no_path(path, "POST"))
        kind = self.headers.get("Content-Type", "").partition(";")[0].strip().lower()
        if body and kind != "application/json":
            raise _Refused(415, f"Content-Type is {kind!r}; expected application/json")
        if not body and self.headers.get("Origin") is None and "Sec-Fetch-Site" in self.headers:
            raise _Refused(403, "a browser's form asks; expected a script of this page")
        try:
            read = json.loads(body) if body.strip() else {}
        except (ValueError, RecursionError) as error:
            raise InputInvalid(f"body: not JSON ({error})") from None
        if not isinstance(read, dict):
            raise InputInvalid(f"body: a {type(read).__name__} was read; expected an object")
        calls = self._client(path)
        if path in ("join", "leave", "pilot"):
            told = {"ok": True, **self._taken(path, calls, read)}
            return b"application/json", json.dumps(told).encode()
        if path == "set":
            return _json(calls, {"call": "set"}, read)
        given = read.pop(_VALUES[path], None) if path in _VALUES else None
        return _json(calls, {**read, "call": path}, given or {})

    def _taken(self, path: str, calls: Calls, said: dict[str, Any]) -> dict[str, Any]:
        if path == "pilot":
            self._needs("pilot", "set", calls.client.allowed)
            return json_of(steered(calls.desk, calls.client, said))  # type: ignore[no-any-return]
        if path == "join":
            return self.door.sessions.join(calls.client, said)
        token = self.headers.get(HEADER)
        if token is None:
            raise InputInvalid(f"leave: no session; expected the header {HEADER} of POST /join")
        self.door.sessions.leave(token)
        return {}

    def _live(self, calls: Calls, names: list[str], query: dict[str, list[str]]) -> None:
        """Send values as they come, as server-sent events, until the client goes."""
        try:
            rate = float(query.get("rate", ["20"])[0])
        except ValueError:
            rate = float("nan")
        if not 0 < rate <= RATE_MAX:
            raise InputInvalid(f"rate: expected a number above 0, at most {RATE_MAX:g} (Hz)")
        found = calls.knowing(lambda: calls.answer({"call": "get", "names": names}, {}))
        if not self.door.streams.acquire(blocking=False):
            raise _Refused(503, f"{STREAMS} live streams are open, which is all that may be")
        self.close_connection = True
        try:
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            last, sent = None, 0.0
            while not self.door.closed.is_set():
                moment = (found.header["tick"], found.header["running"])
                now = time.monotonic()
                if moment != last or now - sent > 2.0:
                    data = json.dumps({**found.header, "values": json_of(found.values)})
                    self.wfile.write(f"data: {data}\n\n".encode())
                    last, sent = moment, now
                self.door.closed.wait(1 / rate)
                found = calls.answer({"call": "get", "names": names}, {})
        except UuvsimError as error:
            self.wfile.write(f"event: refused\ndata: {json.dumps(str(error))}\n\n".encode())
        finally:
            self.door.streams.release()

    def _send(self, status: int, kind: bytes, data: bytes) -> None:
        self.send_response(status)
        if status == 401:
            self.send_header("WWW-Authenticate", 'Basic realm="uuvsim"')
        self.send_header("Content-Type", kind.decode())
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(data)


def _json(calls: Calls, request: Mapping[str, Any], values: object) -> tuple[bytes, bytes]:
    given = calls.knowing(lambda: taken(values, calls.schema))
    found = calls.knowing(lambda: calls.answer(request, given))
    answer = {"ok": True, **found.header}
    if request["call"] in ("get", "step", "run"):
        answer["values"] = json_of(found.values)
    return b"application/json", json.dumps(answer).encode()


def _words(words: str) -> bytes:
    return json.dumps({"ok": False, "error": words}).encode()


def _no_path(path: str, method: str) -> str:
    if path in GET or path in POST:
        return f"/{path} is asked for by {'GET' if path in GET else 'POST'}, not {method}"
    known = ", ".join(f"/{name}" for name in (*GET, *POST))
    return f"/{path} does not exist{near(path, (*GET, *POST))}; expected one of {known}"
