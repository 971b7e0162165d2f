"""The Zenoh door: calls are queries, states are blocks, and who lives is said by liveliness.

Keys, below ``uuvsim/<system>/``: ``call/<name>`` for the calls of the desk, ``state/<component>``
for its blocks, ``live/master``, ``live/component/<component>`` and ``live/client/<id>``.
"""

from __future__ import annotations

import json
import threading
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self, final

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.conductor_calls import Answer
from uuvsim_cosim.bridge.conductor_names import nearest
from uuvsim_cosim.bridge.desk import Client, Moment
from uuvsim_cosim.bridge.roles import NEEDS
from uuvsim_cosim.bridge.stream import Stream
from uuvsim_cosim.bridge.wrapped_session import PORT, listening
from uuvsim_cosim.bridge.zenoh_codec import (
    PROTOCOL,
    message_of,
    packed,
    plain,
    read_message,
    unpacked,
)
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan import Plan
from uuvsim_cosim.orchestrator.system import System

__all__ = ["Bridge", "free_port"]

_CALLS = [*NEEDS, "describe", "schema", "join", "leave"]


@final
class Bridge:
    """Lets a running co-simulation be reached by Zenoh, on this machine unless told otherwise.

    Given a system, it conducts it, and ends it when it is closed; a `Conductor` goes on. Port 0
    is any free one; `port` says which.
    """

    def __init__(
        self,
        system: Conductor | System | Plan | str | Path,
        *,
        port: int = PORT,
        host: str = "127.0.0.1",
        **conducting: Any,
    ) -> None:
        self.port = port if port else free_port(host)
        self.host = host
        self._session = listening(self.port, [host])
        self._own: Conductor | None = None
        try:
            if not isinstance(system, Conductor):
                system = self._own = Conductor(system, **conducting)
            self.conductor = system
            self._clients: dict[str, Client] = {}
            self._lock = threading.Lock()
            self._serve()
        except BaseException:
            self._session.close()
            if self._own is not None:
                self._own.close()
            raise

    def close(self) -> None:
        """Let all clients go; ends the co-simulation if the bridge began it."""
        if self._session.is_open:
            self.conductor.unwatch(self.stream)
        self._session.close()
        if self._own is not None:
            self._own.close()

    def __enter__(self) -> Self:
        """Give the bridge."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close it."""
        self.close()

    # ---- inside ---------------------------------------------------------------------------

    def _serve(self) -> None:
        described = self.conductor.describe()
        self._base = f"uuvsim/{described['system']}"
        session = self._session
        self.stream = Stream(lambda path: session.publisher(f"{self._base}/state/{path}"))
        self.conductor.watch(self.stream)
        self._answering = session.answer(f"{self._base}/call/*", self._asked)
        self._watching = session.watch(f"{self._base}/live/client/*", self._lives)
        paths = [c["path"] for c in described["components"]]
        keys = ["master", *(f"component/{path}" for path in paths)]
        self._tokens = [session.token(f"{self._base}/live/{key}") for key in keys]

    def _lives(self, key: str, lives: bool) -> None:
        if lives:
            return
        with self._lock:
            client = self._clients.pop(key.rpartition("/")[2], None)
        if client is not None:
            try:
                self.conductor.ask("lost", client)
            except InputInvalid:
                return  # it has ended itself

    def _asked(self, query: Any) -> None:
        call = str(query.key_expr).rpartition("/")[2]
        binary = False
        try:
            payload, attached = query.payload, query.attachment
            message = read_message(b"" if payload is None else payload.to_bytes())
            block = b"" if attached is None else attached.to_bytes()
            binary = bool(message.get("binary"))
            answer = self._asking(call, message, block)
        except Exception as error:
            _refuse(query, error)
            return
        answer.add_done_callback(lambda done: self._reply(query, call, message, binary, done))

    def _asking(self, call: str, message: dict[str, Any], block: bytes) -> Answer:
        if call not in _CALLS:
            raise InputInvalid(f"no call {call!r}; expected {nearest(call, _CALLS)}")
        token = str(message.get("client", ""))
        if call == "join":
            return self._join(token, message)
        with self._lock:
            client = self._clients.get(token)
        if client is None:
            if token:
                raise InputInvalid(f"{call}: this client has not joined, or was let go; expected "
                                   "to join first")  # fmt: skip
            client = Client("zenoh", "zenoh")
        if call == "leave":
            with self._lock:
                self._clients.pop(token, None)
        return self.conductor.ask(call, client, *_arguments(call, message, block))

    def _join(self, token: str, message: dict[str, Any]) -> Answer:
        theirs, version = message.get("protocol", PROTOCOL), message.get("version", "unknown")
        if theirs != PROTOCOL:
            raise InputInvalid(
                f"the client (uuvsim-cosim {version}) speaks protocol {theirs}; expected protocol "
                f"{PROTOCOL}, as uuvsim-cosim {__version__} has, which serves here"
            )
        if not token or "/" in token or token in self._clients:
            raise InputInvalid(f"join: client {token!r}; expected an id of its own")
        lag = message.get("lag", 5.0)
        if isinstance(lag, bool) or not isinstance(lag, int | float):
            raise InputInvalid(f"join: lag {lag!r}; expected seconds")
        wanted = Client(str(message.get("name", "zenoh"))[:80], "zenoh")
        answer = self.conductor.ask("join", wanted, bool(message.get("lockstep")), float(lag))

        def joined(done: Answer) -> None:
            if done.exception() is None:
                with self._lock:
                    self._clients[token] = done.result()

        answer.add_done_callback(joined)
        return answer

    def _reply(
        self, query: Any, call: str, message: dict[str, Any], binary: bool, done: Answer
    ) -> None:
        error = done.exception()
        if error is not None:
            _refuse(query, error)
            return
        try:
            told, values = self._told(call, done.result())
            block = b""
            if values is not None:
                if binary:
                    told["values"], block = packed(values)
                else:
                    told["values"] = plain(values)
            query.reply(query.key_expr, json.dumps(told), attachment=block or None, express=True)
        except Exception as wrong:  # told, rather than a client that waits
            _refuse(query, wrong)
        finally:
            query.drop()

    def _told(self, call: str, result: Any) -> tuple[dict[str, Any], Any]:
        """Give the answer in JSON, and the values that go with it."""
        if call == "step":
            return {"moment": asdict(result[0])}, result[1]
        moment = {"moment": asdict(self.conductor.moment())}
        if call in ("get", "run"):
            return moment, result
        if isinstance(result, Moment):
            return {"moment": asdict(result)}, None
        if call == "schema":
            layouts = {p: list(held.names) for p, held in self.stream.layouts.items()}
            signals = [asdict(s) for s in result]
            return {"signals": signals, "layout": self.stream.layout, "blocks": layouts}, None
        if call == "join":
            return moment | {
                "name": result.name,
                "protocol": PROTOCOL,
                "version": __version__,
            }, None
        return moment | {"result": result}, None


def _arguments(call: str, message: dict[str, Any], block: bytes) -> tuple[Any, ...]:
    def values(key: str) -> dict[str, Any]:
        return unpacked(message.get(key) or {}, block)

    def names(key: str) -> list[str]:
        given = message.get(key) or []
        if not isinstance(given, list) or not all(isinstance(n, str) for n in given):
            raise InputInvalid(f"{call}: {key} {given!r}; expected a list of names")
        return given

    def number(key: str) -> float | None:
        given = message.get(key)
        if given is not None and (isinstance(given, bool) or not isinstance(given, int | float)):
            raise InputInvalid(f"{call}: {key} {given!r}; expected a number")
        return given

    match call:
        case "get":
            return (names("names"),)
        case "set":
            return (values("values"),)
        case "step":
            return (message.get("n", 1), values("inputs"), names("outputs"))
        case "run":
            return (number("until"), number("factor"), names("record"))
        case "reset":
            return (message.get("seed"), values("start"))
        case "restore":
            return (str(message.get("snapshot", "")),)
        case "replace":
            mapping = message.get("mapping")
            if mapping is not None and not isinstance(mapping, dict):
                raise InputInvalid(f"replace: mapping {mapping!r}; expected an object of names")
            return (str(message.get("component", "")), str(message.get("source", "")), mapping)
    return ()


def _refuse(query: Any, error: BaseException) -> None:
    import contextlib

    with contextlib.suppress(Exception):  # whoever asked is gone
        query.reply_err(json.dumps(message_of(error)))
        query.drop()


def free_port(host: str) -> int:
    """Find a port that nobody listens on."""
    import socket

    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as s:
        s.bind((host, 0))
        return int(s.getsockname()[1])
