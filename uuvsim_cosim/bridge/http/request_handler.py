"""Answers to HTTP requests: the call of each path, authentication, and the format of answers."""

from __future__ import annotations

import base64
import binascii
import hmac
import html
import json
import secrets
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from http.server import BaseHTTPRequestHandler
from itertools import chain
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access.authentication import Admission, Authenticator
from uuvsim_cosim.bridge.access.roles import NEEDS
from uuvsim_cosim.bridge.access.tls import common_name
from uuvsim_cosim.bridge.calls.call_table import CALLS, checked, read_object
from uuvsim_cosim.bridge.calls.connection_limits import ConnectionSlots, Limits
from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.calls.time_sharing import READS, RateLimit, share_of
from uuvsim_cosim.bridge.calls.values import json_of, json_texts
from uuvsim_cosim.bridge.http.manual_axes import pilots, steer
from uuvsim_cosim.bridge.http.sessions import HEADER, Sessions
from uuvsim_cosim.bridge.tcp.framing import Disconnected
from uuvsim_cosim.bridge.tcp.requests import Calls, failure
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.near_names import did_you_mean

__all__ = ["Endpoint", "Handler"]

GET = ("describe", "schema", "signals", "live", "pilots")
POST = (*(call for call in CALLS if call not in READS), "pilot")
STREAMS = 8
RATE_MAX = 50.0  # Hz, of live values
_QUERY = {"signals": ("names",), "live": ("names", "rate")}
_SMALL = 1 << 14  # numbers of an answer that is sent whole; a larger one is sent in pieces
_Content = tuple[bytes, bytes | Iterator[str]]  # media type, and text whole or in pieces

_NOBODY = Client("http", "http", frozenset())
# Each page is one file of HTML that loads nothing else.
_PAGES = {"/": "page.html", "/index.html": "page.html", "/pilot": "pilot.html"}
_ASKING = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>uuvsim</title></head>
<body><p>{}</p><p>`uuvsim serve` prints an address with the token, and `uuvsim access token` prints
the token.</p><form><label>Token <input name="token" type="password" autocomplete="off"></label>
<button>Enter</button></form></body></html>
"""


class Endpoint:
    """State that all connections of one HTTP server share."""

    def __init__(self, service: Service, admit: Admission, limits: Limits, *, local: bool) -> None:
        self.service = service
        self.admit = admit
        self.limits = limits
        self.local = local  # reached by loopback only
        self.closed = threading.Event()
        self.slots = ConnectionSlots(limits)
        self.streams = threading.BoundedSemaphore(STREAMS)
        self.sessions = Sessions(service, limits.answer_bytes)
        self.share = share_of(service)
        self.token = admit.access.token if isinstance(admit, Authenticator) else None
        self.cookie = secrets.token_urlsafe(32)  # a browser sends it instead of the token

    @property
    def full(self) -> str:
        """The message to a client if all places are in use."""
        return f"{self.limits.clients} clients are connected, the maximum; close one"


class _Refused(Exception):
    """An answer with another status than 400."""

    def __init__(self, status: int, words: str) -> None:
        self.status = status
        super().__init__(words)


class Handler(BaseHTTPRequestHandler):
    """The requests of one connection."""

    endpoint: Endpoint
    protocol_version = "HTTP/1.1"
    server_version = f"uuvsim-cosim/{__version__}"
    sys_version = ""
    _pace: RateLimit | None = None
    _mark: float = 0.0  # [s] of this thread's processor time at the end of the last answer
    _reader: Client | None = None  # the client that has waited for its turn
    _calls: Calls | None = None

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing; the base class would print each request."""

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Refuse an invalid request in JSON, like all other errors."""
        self.close_connection = True
        expected = "GET or POST" if code == 501 else "a request of HTTP/1.1"
        self._send(
            405 if code == 501 else code,
            b"application/json",
            _error(f"{message}; expected {expected}"),
        )

    def do_GET(self) -> None:
        """Answer a GET: a page, or a call that changes nothing."""
        parts = urlsplit(self.path)
        path, query = parts.path, parse_qs(parts.query)
        if path in _PAGES:
            self._answered(lambda: self._page(path, query))
        else:
            self._answered(lambda: self._read(path.strip("/"), query))

    def do_POST(self) -> None:
        """Answer a POST: a call with a JSON object as body."""
        limits, length = self.endpoint.limits, self.headers.get("Content-Length", "0")
        try:
            if not length.isascii() or not length.isdigit() or "Transfer-Encoding" in self.headers:
                raise _Refused(411, "a body needs its length in Content-Length")
            if int(length) > limits.payload_bytes:
                raise _Refused(
                    413,
                    f"a body of {length} bytes was announced; at most {limits.payload_bytes} are "
                    "read",
                )
            if int(length) > limits.unknown_bytes:  # only from a client that is authenticated
                self._allowed()
            body = self.rfile.read(int(length))
        except _Refused as refused:
            self.close_connection = True
            self._send(refused.status, b"application/json", _error(str(refused)))
            return
        token = self.headers.get(HEADER)
        self.endpoint.sessions.note_request(token, begins=True)
        try:
            self._answered(lambda: self._called(urlsplit(self.path).path.strip("/"), body))
        finally:
            self.endpoint.sessions.note_request(token, begins=False)

    def _answered(self, answer: Callable[[], _Content | None]) -> None:
        """Send what `answer` returns, or the error that it raises; None has been sent already."""
        if self._pace is None:
            self._pace = RateLimit(self.endpoint.limits.calls_per_s)
        self._pace.wait()
        try:
            # Refuse requests that other web sites make a browser send (CSRF and DNS rebinding).
            host = self.headers.get("Host", "")
            name = host.rsplit(":", 1)[0] if not host.endswith("]") else host
            if self.endpoint.local and name not in ("localhost", "127.0.0.1", "[::1]"):
                raise _Refused(403, f"host {host!r} was requested; expected localhost or 127.0.0.1")
            origin = self.headers.get("Origin")
            if origin is not None and urlsplit(origin).netloc != host:
                raise _Refused(
                    403, f"the request is from a page of {origin}; expected a page of http://{host}"
                )
            if (found := answer()) is not None:
                self._send(200, *found)
        except _Refused as refused:
            self._send(refused.status, b"application/json", _error(str(refused)))
        except Disconnected as error:
            raise ConnectionAbortedError(str(error)) from None
        except UuvsimError as error:
            self._send(400, b"application/json", json.dumps(failure(error)).encode())
        except (OSError, TimeoutError):
            raise
        except Exception as error:  # an internal error must not end the server
            self._send(500, b"application/json", json.dumps(failure(error)).encode())
        finally:
            if self.command == "GET" and self._reader is not None:
                self._has_read(self._reader)
            self._mark = time.thread_time()

    def _wait_for_turn(self, client: Client) -> None:
        """Wait for the client's turn, as all reading calls do while others step."""
        self._reader = client
        self.endpoint.share.wait(client, self.endpoint.share.turn(client))

    def _has_read(self, client: Client) -> None:
        before, self._mark = self._mark, time.thread_time()
        self.endpoint.share.took(client, self._mark - before)

    def _page(self, path: str, query: dict[str, list[str]]) -> _Content | None:
        """Return a page; an address with the token is redirected, with a cookie instead."""
        media_type = b"text/html; charset=utf-8"
        text = Path(__file__).with_name(_PAGES[path]).read_bytes()
        if self.endpoint.token is None:
            return media_type, text
        shown = query.get("token", [None])[0]
        try:
            self.endpoint.admit(None, None, None, shown or self._token())
        except UuvsimError as error:
            self._send(401, media_type, _ASKING.format(html.escape(str(error))).encode())
            return None
        if shown is None:
            return media_type, text
        # Lax, not Strict, so that a link in a terminal that is itself a web page works. That is
        # safe: a GET changes nothing, and other sites cannot read its answer.
        secure = "; Secure" if isinstance(self.connection, ssl.SSLSocket) else ""
        cookie = f"{self._cookie_name()}={self.endpoint.cookie}"
        self._send_head(
            303,
            {
                "Location": path,
                "Set-Cookie": f"{cookie}; HttpOnly; SameSite=Lax; Path=/{secure}",
                "Content-Length": "0",
                "Referrer-Policy": "no-referrer",
            },
        )
        return None

    def _cookie_name(self) -> str:
        """Return the name of the cookie; browsers send cookies to every port of a host."""
        return f"uuvsim-{self.connection.getsockname()[1]}"

    def _token(self) -> str | None:
        """Return the token that a request has in its header or by its cookie."""
        scheme, _, shown = self.headers.get("Authorization", "").partition(" ")
        if scheme.lower() == "bearer":
            return shown.strip()
        for pair in self.headers.get("Cookie", "").split(";"):
            name, _, value = pair.strip().partition("=")
            right = hmac.compare_digest(
                value.encode("utf-8", "replace"), self.endpoint.cookie.encode()
            )
            if name == self._cookie_name() and right:
                return self.endpoint.token
        return None

    def _allowed(self) -> tuple[str | None, frozenset[str]]:
        """Authenticate the client; return its user's name and its permissions."""
        user = password = None
        scheme, _, code = self.headers.get("Authorization", "").partition(" ")
        if scheme.lower() == "basic":
            try:
                user, _, password = base64.b64decode(code, validate=True).decode().partition(":")
            except (binascii.Error, UnicodeDecodeError):
                raise _Refused(400, "Authorization: expected Basic, in base64") from None
        try:
            name = common_name(self.connection)
            allowed = self.endpoint.admit(user, password, name, self._token())
        except UuvsimError as error:
            raise _Refused(401, str(error)) from None
        if not self.endpoint.slots.admit(self.connection):
            self.close_connection = True
            raise _Refused(503, self.endpoint.full)
        return user, allowed

    def _client(self, call: str) -> Calls:
        """Return the calls of the client, of its session if it has joined."""
        user, allowed = self._allowed()
        self._needs(call, NEEDS.get(call), allowed)
        token = self.headers.get(HEADER)
        if token is not None:
            calls = self.endpoint.sessions.calls(token, allowed)
            calls.attended(self.connection)
            return calls
        if self._calls is None or self._calls.client.allowed != allowed:
            most = self.endpoint.limits.answer_bytes
            self._calls = Calls(
                self.endpoint.service, Client(user or "http", "http", allowed, most)
            )
            self._calls.attended(self.connection)
        return self._calls

    def _needs(self, call: str, needed: str | None, allowed: frozenset[str]) -> None:
        if needed is not None and needed not in allowed:
            may = ", ".join(sorted(allowed)) or "nothing"
            raise _Refused(403, f"{call}: this call needs {needed!r}; your role may {may}")

    def _read(self, path: str, query: dict[str, list[str]]) -> _Content | None:
        """Return the answer of a GET; None if it was a stream, which has ended."""
        if path not in GET:
            raise _Refused(405 if path in POST else 404, _no_path(path, "GET"))
        known = _QUERY.get(path, ())
        for field in query:
            if field not in known:
                raise InputInvalid(
                    f"/{path}",
                    f"query {field!r} does not exist{did_you_mean(field, known)}",
                    " and ".join(known) or "none",
                )
        names = [n for value in query.get("names", []) for n in value.split(",") if n]
        calls = self._client("get" if path in ("signals", "live") else path)
        self._wait_for_turn(calls.client)
        if path == "live":
            self._live(calls, names, query)
            return None
        if path == "signals":
            if not names:
                raise InputInvalid("/signals", "no names", "such as /signals?names=hull.eta")
            return _json(calls, "get", {"names": names})
        if path == "pilots":
            return b"application/json", json.dumps({"ok": True, **pilots(calls.service)}).encode()
        return _json(calls, path, {})

    def _called(self, path: str, body: bytes) -> _Content:
        """Return the answer of a POST."""
        if path not in POST:
            raise _Refused(405 if path in (*GET, "") else 404, _no_path(path, "POST"))
        media_type = self.headers.get("Content-Type", "").partition(";")[0].strip().lower()
        if body and media_type != "application/json":
            raise _Refused(415, f"Content-Type is {media_type!r}; expected application/json")
        if not body and self.headers.get("Origin") is None and "Sec-Fetch-Site" in self.headers:
            raise _Refused(403, "the request is from a form; expected a script of this page")
        read = read_object(body.strip(), "body")
        calls = self._client(path)
        self._reader = calls.client
        answer: object = {"ok": True}
        if path == "pilot":
            self._needs("pilot", "set", calls.client.allowed)
            answer = json_of({"ok": True, **steer(calls.service, calls.client, read)})
        elif path == "join":
            answer = {"ok": True, **self.endpoint.sessions.join(calls.client, read)}
        elif path == "leave":
            checked("leave", read)
            token = self.headers.get(HEADER)
            if token is None:
                raise InputInvalid("leave", "no session", f"the header {HEADER} of POST /join")
            self.endpoint.sessions.leave(token)
        else:
            return _json(calls, path, {"values": read} if path == "set" else read)
        return b"application/json", json.dumps(answer).encode()

    def _live(self, calls: Calls, names: list[str], query: dict[str, list[str]]) -> None:
        """Send values continuously, as server-sent events, until the client disconnects."""
        try:
            rate = float(query.get("rate", ["20"])[0])
        except ValueError:
            rate = float("nan")
        if not 0 < rate <= RATE_MAX:
            raise InputInvalid(f"rate: expected a number above 0, at most {RATE_MAX:g} (Hz)")
        found = calls.answer("get", {"names": names})
        if not self.endpoint.streams.acquire(blocking=False):
            raise _Refused(503, f"{STREAMS} live streams are open, the maximum")
        self.close_connection = True
        try:
            self._send_head(200, {"Content-Type": "text/event-stream"})
            last, sent = None, 0.0
            while not self.endpoint.closed.is_set():
                moment = (found.header["tick"], found.header["running"])
                now = time.monotonic()
                if moment != last or now - sent > 2.0:
                    data = json.dumps({**found.header, "values": json_of(found.values)})
                    self.wfile.write(f"data: {data}\n\n".encode())
                    last, sent = moment, now
                self.endpoint.closed.wait(1 / rate)
                self._has_read(calls.client)
                self._wait_for_turn(calls.client)
                found = calls.answer("get", {"names": names})
        except UuvsimError as error:
            self.wfile.write(f"event: refused\ndata: {json.dumps(str(error))}\n\n".encode())
        finally:
            self.endpoint.streams.release()

    def _send(self, status: int, media_type: bytes, data: bytes | Iterator[str]) -> None:
        """Send an answer; between two pieces of a large one, other clients step."""
        headers = {
            "Content-Type": media_type.decode(),
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",  # no other page may overlay ours (clickjacking)
            "Referrer-Policy": "no-referrer",
        }
        if status == 401:
            how = "Basic" if self.endpoint.token is None else "Bearer"
            headers["WWW-Authenticate"] = f'{how} realm="uuvsim"'
        if isinstance(data, bytes):
            headers["Content-Length"] = str(len(data))
        elif self.request_version == "HTTP/1.1":
            headers["Transfer-Encoding"] = "chunked"
        else:
            self.close_connection = True
        self._send_head(status, headers)
        if isinstance(data, bytes):
            self.wfile.write(data)
            return
        client = self._reader or _NOBODY
        chunked = self.request_version == "HTTP/1.1"
        for text in data:
            part = text.encode()
            self.wfile.write(b"%x\r\n%s\r\n" % (len(part), part) if chunked else part)
            self._has_read(client)
            self._wait_for_turn(client)
        if chunked:
            self.wfile.write(b"0\r\n\r\n")

    def _send_head(self, status: int, headers: Mapping[str, str]) -> None:
        self.send_response(status)
        for name, value in {**headers, "Cache-Control": "no-store"}.items():
            self.send_header(name, value)
        self.end_headers()


def _json(calls: Calls, call: str, request: Mapping[str, object]) -> _Content:
    """Return an answer in JSON: bytes, or an iterator of texts if it is large."""
    found = calls.answer(call, request)
    if call not in ("get", "step", "run"):
        return b"application/json", f"{found.header_text}}}".encode()
    texts = chain((f'{found.header_text}, "values": ',), json_texts(found.values), ("}",))
    if sum(np.size(value) for value in found.values.values()) <= _SMALL:
        return b"application/json", "".join(texts).encode()
    return b"application/json", texts


def _error(message: str) -> bytes:
    return json.dumps({"ok": False, "error": message}).encode()


def _no_path(path: str, method: str) -> str:
    if path in GET or path in POST:
        return f"/{path} needs {'GET' if path in GET else 'POST'}, not {method}"
    known = ", ".join(f"/{name}" for name in (*GET, *POST))
    return f"/{path} does not exist{did_you_mean(path, (*GET, *POST))}; expected one of {known}"
