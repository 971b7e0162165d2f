"""Transcripts: fixed requests over TCP, HTTP and Zenoh to `uuvsim serve`, with the answers.

The clients here are a few lines on sockets and on the Zenoh library. They import nothing of the
package, so that they hold the wire formats and not the client.
"""

from __future__ import annotations

import http.client
import json
import os
import re
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import uuvsim_cosim as uuv

HERE = Path(__file__).parent
SYSTEM = HERE / "system" / "frozen.ssd"
FOREVER = 10_000_000.0  # [s] that Zenoh waits for an answer; `tests/processor_time.py` ends it

Request = tuple[str, dict[str, Any]]
SNAPSHOT = "<the snapshot>"

CALLS: Sequence[Request] = (
    ("describe", {}),
    ("schema", {}),
    ("get", {"names": ["sum.s", "sum.both", "hull.eta"]}),
    ("get", {"names": ["sum.t"]}),
    ("set", {"values": {"sum.a": 0.5, "sum.gains": [1.0, 2.0]}}),
    ("set", {"values": {"sum.b": "3.6 km/h"}}),
    ("set", {"values": {"sum.b": "3.6 kg"}}),
    ("set", {"values": {"sum.gains": [1.0, 2.0, 3.0]}}),
    ("set", {"values": {"sum.s": 1.0}}),
    ("step", {"n": 2, "outputs": ["sum.s", "sum.both"]}),
    ("step", {"dt": 0.2, "inputs": {"sum.a": 0.25}, "outputs": ["sum.s"]}),
    ("step", {"dt": 0.05}),
    ("step", {"n": 0}),
    ("step", {"steps": 2}),
    ("jump", {}),
    ("snapshot", {}),
    ("step", {"n": 3, "outputs": ["sum.s"]}),
    ("restore", {"snapshot": SNAPSHOT}),
    ("get", {"names": ["sum.s"]}),
    ("discard", {"snapshot": SNAPSHOT}),
    ("restore", {"snapshot": "none"}),
    ("run", {"duration": 0.3, "record": ["sum.s", "sum.both"]}),
    ("run", {"duration": -1}),
    ("pause", {}),
    ("reset", {"seed": 7, "start": {"sum.k": 2.0}}),
    ("step", {"inputs": {"sum.a": 1.0}, "outputs": ["sum.s", "hull.eta"]}),
    ("step", {"inputs": {"sum.a": 13.0}}),
    ("step", {}),
    ("reset", {}),
    ("dismiss", {"name": "nobody"}),
    ("replace", {"component": "nothing", "source": "sphere"}),
    ("replace", {"component": "hull", "source": "sphere"}),
)


def transcripts(folder: Path) -> dict[str, Any]:
    """Return by transport a list of requests and their answers."""
    found = {}
    for name, record in (("TCP", _tcp), ("HTTP", _http), ("Zenoh", _zenoh)):
        with _served(folder) as endpoints:
            found[name] = [
                {"request": request, "answer": _normal(answer)}
                for request, answer in record(endpoints)
            ]
    return found


@contextmanager
def _served(folder: Path) -> Iterator[Mapping[str, list[str]]]:
    command = "serve --paused --no-record --anyone --port 0 --tcp-port 0 --http-port 0 --json"
    process = subprocess.Popen(
        [sys.executable, "-m", "uuvsim_cosim", *command.split(), str(SYSTEM)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(uuv.__file__).parents[1])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        text = ""
        for line in process.stdout:
            text += line
            try:
                yield json.loads(text)["endpoints"]
                break
            except json.JSONDecodeError:
                continue
        else:
            raise AssertionError(f"uuvsim serve ended: {process.stderr and process.stderr.read()}")
    finally:
        process.terminate()
        process.communicate()


def _asked(ask: Callable[[str, dict[str, Any]], Any]) -> Iterator[tuple[Request, Any]]:
    """Ask all calls; the name of the newest snapshot is put in where a request needs it."""
    snapshot = ""
    for call, fields in CALLS:
        given = {k: snapshot if v == SNAPSHOT else v for k, v in fields.items()}
        answer = ask(call, given)
        if call == "snapshot":
            snapshot = _find(answer, "snapshot") or _find(answer, "result")
        yield (call, fields), answer


def _find(answer: Any, key: str) -> Any:
    if isinstance(answer, dict):
        if key in answer:
            return answer[key]
        for value in answer.values():
            if (found := _find(value, key)) is not None:
                return found
    return None


def _port(address: str) -> int:
    return int(re.findall(r":(\d+)", address)[-1])


# ---- TCP ------------------------------------------------------------------------------------


class _Tcp:
    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.greeting = self.answer()

    def ask(self, header: Mapping[str, Any] | None, numbers: Sequence[float] = ()) -> Any:
        text = b"" if header is None else json.dumps(header).encode()
        data = struct.pack(f"<{len(numbers)}d", *numbers)
        self.socket.sendall(struct.pack("<II", len(text), len(data)) + text + data)
        return self.answer()

    def answer(self) -> Any:
        lengths = struct.unpack("<II", self._exactly(8))
        header, body = (self._exactly(n) for n in lengths)
        numbers = list(struct.unpack(f"<{len(body) // 8}d", body))
        return {"header": json.loads(header) if header else None, "numbers": numbers}

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.socket.recv(count - len(data))
            if not more:
                raise EOFError
            data += more
        return data


def _tcp(endpoints: Mapping[str, list[str]]) -> Iterator[tuple[Request, Any]]:
    port = _port(endpoints["tcp"][0])
    wrong = _Tcp(port)
    yield ("greeting", {}), wrong.greeting
    yield ("hello", {"protocol": 99}), wrong.ask({"call": "hello", "protocol": 99})
    wrong.socket.close()
    peer = _Tcp(port)
    hello = {"protocol": 1, "name": "frozen"}
    yield ("hello", hello), peer.ask({"call": "hello", **hello})
    yield from _asked(lambda call, fields: peer.ask({"call": call, **fields}))
    layout = {"inputs": ["sum.a", "sum.gains"], "outputs": ["sum.s", "sum.both"]}
    yield ("layout", layout), peer.ask({"call": "layout", **layout})
    compact = [2.0, 0.5, 1.0, 2.0]
    yield ("compact step", {"numbers": compact}), peer.ask(None, compact)
    peer.socket.close()
    joining = {"protocol": 1, "name": "first", "lockstep": True, "lag": 60.0}
    first = _Tcp(port)
    yield ("hello", joining), first.ask({"call": "hello", **joining})
    first.socket.close()


# ---- HTTP -----------------------------------------------------------------------------------


def _http(endpoints: Mapping[str, list[str]]) -> Iterator[tuple[Request, Any]]:
    port = _port(endpoints["http"][0])
    link = http.client.HTTPConnection("127.0.0.1", port)
    headers = {"Content-Type": "application/json"}

    def ask(method: str, path: str, body: str | None = None, **more: str) -> Any:
        link.request(method, path, body, {**(headers if body else {}), **more})
        answer = link.getresponse()
        content = answer.read().decode()
        kind = answer.getheader("Content-Type", "")
        return {
            "status": answer.status,
            "headers": " ".join(sorted(name.lower() for name, _ in answer.getheaders())),
            "type": kind,
            "body": json.loads(content) if "json" in kind else "<not JSON>",
        }

    def call(name: str, fields: dict[str, Any]) -> Any:
        if name in ("describe", "schema"):
            return ask("GET", f"/{name}")
        if name == "get":
            return ask("GET", f"/signals?names={','.join(fields['names'])}")
        return ask("POST", f"/{name}", json.dumps(fields.get("values", fields)))

    yield from _asked(call)
    joined = ask("POST", "/join", json.dumps({"name": "frozen", "lockstep": True, "lag": 60}))
    yield ("join", {"name": "frozen", "lockstep": True, "lag": 60}), joined
    session = {"Uuvsim-Session": str(_find(joined, "session"))}
    yield ("step as frozen", {}), ask("POST", "/step", "{}", **session)
    yield ("describe while frozen", {}), ask("GET", "/describe")
    yield ("leave", {}), ask("POST", "/leave", "{}", **session)
    for method, path, body in (
        ("GET", "/", None),
        ("GET", "/pilots", None),
        ("GET", "/nothing", None),
        ("GET", "/step", None),
        ("POST", "/step", "{"),
        ("POST", "/step", '{"n": 1, "n": 2}'),
        ("DELETE", "/step", None),
    ):
        link.close()  # some refusals end the connection; the next request opens another
        yield (f"{method} {path}", {"body": body}), ask(method, path, body)
    link.close()
    other = ask("GET", "/describe", Origin="http://example.org")
    yield ("GET /describe of another origin", {}), other
    link.close()


# ---- Zenoh ----------------------------------------------------------------------------------


def _zenoh(endpoints: Mapping[str, list[str]]) -> Iterator[tuple[Request, Any]]:
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps(endpoints["zenoh"][:1]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:

        def ask(call: str, fields: Mapping[str, Any]) -> Any:
            key = f"uuvsim/frozen/call/{call}"
            replies = session.get(key, payload=json.dumps(fields), timeout=FOREVER)
            for reply in replies:
                sample = reply.err if reply.ok is None else reply.ok
                attached = getattr(sample, "attachment", None)
                return {
                    "ok": reply.ok is not None,
                    "encoding": str(sample.encoding),
                    "body": json.loads(sample.payload.to_bytes()),
                    "attachment": None if attached is None else attached.to_bytes().hex(),
                }
            return "no reply"

        yield from _asked(ask)
        binary = {"names": ["sum.s", "sum.both"], "binary": True}
        yield ("get", binary), ask("get", binary)
        blocks = session.declare_subscriber(
            "uuvsim/frozen/state/sum", zenoh.handlers.FifoChannel(9)
        )
        ask("describe", {})
        ask("step", {"inputs": {"sum.a": 2.0}})
        block = blocks.recv()
        data = block.payload.to_bytes()
        yield (
            ("state/sum after a step", {}),
            {
                "encoding": str(block.encoding),
                "tick, time, layout": struct.unpack("<qdq", data[:24]),
                "values": struct.unpack(f"<{len(data[24:]) // 8}d", data[24:]),
            },
        )
        live = session.liveliness().get("uuvsim/frozen/live/**", timeout=FOREVER)
        keys = sorted(str(r.ok.key_expr) for r in live if r.ok is not None)
        yield ("live/**", {}), keys
        alive = session.liveliness().declare_token("uuvsim/frozen/live/client/f1")
        joining = {"client": "f1", "name": "frozen", "lockstep": True, "lag": 60, "protocol": 99}
        yield ("join", joining), ask("join", joining)
        joining["protocol"] = 1
        yield ("join", joining), ask("join", joining)
        yield ("leave", {"client": "f1"}), ask("leave", {"client": "f1"})
        alive.undeclare()


# ---- what differs from run to run -----------------------------------------------------------

_TEXT = (
    (re.compile(re.escape(uuv.__version__)), "<version>"),
    (re.compile(re.escape(str(HERE))), "<here>"),
    (re.compile(r"\b[0-9a-f]{16,}\b"), "<token>"),
    (re.compile(r"(?<=127\.0\.0\.1:)\d+"), "<port>"),
)
_KEYS = {"session": "<session>", "snapshot": SNAPSHOT, "id": "<id>", "busy": "<seconds>"}


def _normal(answer: Any, key: str = "") -> Any:
    if isinstance(answer, dict):
        return {k: _normal(v, k) for k, v in answer.items()}
    if isinstance(answer, list | tuple):
        return [_normal(v) for v in answer]
    if isinstance(answer, str | float) and key in _KEYS:
        return _KEYS[key]
    if isinstance(answer, str):
        for pattern, text in _TEXT:
            answer = pattern.sub(text, answer)
    return answer


def messages(record: Any) -> tuple[Any, list[str]]:
    """Split transcripts into answers without the wording of refusals, and that wording."""
    found: list[str] = []

    def without(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {k: without(v, k) for k, v in value.items()}
        if isinstance(value, list):
            return [without(v) for v in value]
        if isinstance(value, str) and key in ("error", "message", "description", "failed"):
            found.append(value)
            return "<text>"
        return value

    return without(record), found
