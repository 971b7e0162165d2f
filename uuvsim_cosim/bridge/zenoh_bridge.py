"""The Zenoh door: calls are queries, states are blocks, and who lives is said by liveliness.

Keys, below ``uuvsim/<system>/``: ``call/<name>`` for the calls of the desk, ``state/<component>``
for its blocks, ``live/master``, ``live/component/<component>`` and ``live/client/<id>``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, final

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access_doorkeeper import Doorkeeper
from uuvsim_cosim.bridge.access_zenoh import guarded
from uuvsim_cosim.bridge.conductor import Conductor
from uuvsim_cosim.bridge.conductor_calls import Answer
from uuvsim_cosim.bridge.conductor_names import nearest
from uuvsim_cosim.bridge.desk import Client, Moment
from uuvsim_cosim.bridge.roles import NEEDS
from uuvsim_cosim.bridge.shared_memory import SharedMemory
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
from uuvsim_cosim.bridge.zenoh_gate import MOST_BYTES, Gate, Lane
from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master import Master
from uuvsim_cosim.orchestrator.plan import Plan
from uuvsim_cosim.orchestrator.system import System

__all__ = ["Bridge", "free_port"]

_CALLS = [*NEEDS, "describe", "schema", "join", "leave"]


@final
class Bridge(Closing):
    """Lets a running co-simulation be reached by Zenoh, on this machine unless told otherwise.

    Given a system, it conducts it, and ends it when it is closed; a `Conductor` goes on. Port 0
    is any free one; `port` says which. With `access` clients say who they are. Large blocks
    reach clients on this machine by shared memory, unless told otherwise.
    """

    def __init__(
        self,
        system: Conductor | System | Plan | Master | str | Path,
        *,
        port: int = PORT,
        host: str | Sequence[str] = "127.0.0.1",
        access: Doorkeeper | None = None,
        shared_memory: bool = True,
        **conducting: Any,
    ) -> None:
        self.hosts = (host,) if isinstance(host, str) else tuple(host)
        self.host = self.hosts[0]
        self.port = port if port else free_port(self.host)
        self._gate = Gate(access)
        said = None if access is None else access.access
        self.tls = said is not None and said.tls is not None
        self._shared = shared_memory
        self._waiting: dict[str, Answer] = {}  # the last run or steps that each client asked for
        with guarded(said, self._gate.reader) as settings:
            settings = {"transport/shared_memory/enabled": shared_memory, **settings}
            self._session = listening(self.port, self.hosts, settings, tls=self.tls)
        self._own: Conductor | None = None
        try:
            if not isinstance(system, Conductor):
                system = self._own = Conductor(system, **conducting)
            self.conductor = system
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
        self._gate.close()
        if self._own is not None:
            self._own.close()

    # ---- inside ---------------------------------------------------------------------------

    def _serve(self) -> None:
        described = self.conductor.describe()
        self._base = f"uuvsim/{described['system']}"
        session = self._session
        self.stream = Stream(
            lambda path: session.publisher(f"{self._base}/state/{path}"),
            SharedMemory(wanted=self._shared),
        )
        self.conductor.watch(self.stream)
        self._answering = [
            session.answer(f"{self._base}/call/*", self._asked),
            session.answer(f"{self._base}/certificate/*", self._shown),
        ]
        self._watching = session.watch(f"{self._base}/live/client/*", self._lives)
        paths = [c["path"] for c in described["components"]]
        keys = ["master", *(f"component/{path}" for path in paths)]
        self._tokens = [session.token(f"{self._base}/live/{key}") for key in keys]

    def _lives(self, key: str, lives: bool) -> None:
        if lives:
            return
        token = key.rpartition("/")[2]
        if (waiting := self._waiting.pop(token, None)) is not None:
            self.conductor.abandon(waiting)
        client = self._gate.leave(token)
        if client is not None:
            try:
                self.conductor.ask("lost", client)
            except InputInvalid:
                return  # it has ended itself

    def _asked(self, query: Any) -> None:
        self._take(query, str(query.key_expr).rpartition("/")[2], None)

    def _shown(self, query: Any) -> None:
        """Join one whose certificate Zenoh has verified: it lets nobody else ask this key."""
        self._take(query, "join", str(query.key_expr).rpartition("/")[2])

    def _take(self, query: Any, call: str, certificate: str | None) -> None:
        """Ask for a call, or refuse it; all that is answered leaves by the client's lane."""
        wrong: Exception | None = None
        message: dict[str, Any] = {}
        try:
            message, block = _read(query)
        except Exception as error:
            wrong = error
        lane = self._gate.lane(call, message)
        taken = lane.take()
        if taken is None:
            query.drop()
            return
        try:
            if wrong is not None:
                raise wrong
            if not taken:
                raise InputInvalid(f"{call}: too many calls wait for their answer; expected fewer")
            if call == "join":
                lane.put(lambda: self._join(query, message, certificate))
                return
            answer = self._asking(call, message, block)
        except Exception as error:
            lane.put(partial(_refuse, query, error))
            return
        answer.add_done_callback(partial(self._answered, lane, query, call, message))

    def _asking(self, call: str, message: dict[str, Any], block: bytes) -> Answer:
        if call not in _CALLS:
            raise InputInvalid(f"no call {call!r}; expected {nearest(call, _CALLS)}")
        client = self._gate.client(call, message)
        if call == "leave":
            self._gate.leave(str(message.get("client", "")))
        answer = self.conductor.ask(call, client, *_arguments(call, message, block))
        if call in ("run", "step"):
            self._waiting[str(message.get("client", ""))] = answer
        return answer

    def _join(self, query: Any, message: dict[str, Any], certificate: str | None) -> None:
        """Enter a client; in a thread of its own, for passwords take a while."""
        try:
            theirs, version = message.get("protocol", PROTOCOL), message.get("version", "unknown")
            if theirs != PROTOCOL:
                raise InputInvalid(
                    f"the client (uuvsim-cosim {version}) speaks protocol {theirs}; expected "
                    f"protocol {PROTOCOL}, as uuvsim-cosim {__version__} has, which serves here"
                )
            lag = message.get("lag", 5.0)
            if isinstance(lag, bool) or not isinstance(lag, int | float):
                raise InputInvalid(f"join: lag {lag!r}; expected seconds")
            allowed = self._gate.allowed(message, certificate)
            wanted = Client(str(message.get("name", "zenoh"))[:80], "zenoh", allowed)
            lockstep = bool(message.get("lockstep"))
            client = self.conductor.join(wanted, lockstep=lockstep, lag=float(lag))
            told = {
                "moment": asdict(self.conductor.moment()), "name": client.name,
                "protocol": PROTOCOL, "version": __version__, **self._gate.enter(message, client),
            }  # fmt: skip
            query.reply(query.key_expr, json.dumps(told), express=True)
        except Exception as error:
            _refuse(query, error)
        finally:
            query.drop()

    def _answered(
        self, lane: Lane, query: Any, call: str, message: dict[str, Any], done: Answer
    ) -> None:
        """Hand an answer on, in the conductor's thread: it never waits for a client."""
        moment = self.conductor.moment()
        lane.put(lambda: self._reply(query, call, message, moment, done))

    def _reply(
        self, query: Any, call: str, message: dict[str, Any], moment: Moment, done: Answer
    ) -> None:
        error = done.exception()
        if error is not None:
            _refuse(query, error)
            return
        try:
            told, values = self._told(call, done.result(), moment)
            block = b""
            if values is not None:
                if message.get("binary"):
                    told["values"], block = packed(values)
                else:
                    told["values"] = plain(values)
            query.reply(query.key_expr, json.dumps(told), attachment=block or None, express=True)
        except Exception as wrong:  # told, rather than a client that waits
            _refuse(query, wrong)
        finally:
            query.drop()

    def _told(self, call: str, result: Any, at: Moment) -> tuple[dict[str, Any], Any]:
        """Give the answer in JSON, and the values that go with it."""
        if call == "step":
            return {"moment": asdict(result[0])}, result[1]
        moment = {"moment": asdict(at)}
        if call in ("get", "run"):
            return moment, result
        if isinstance(result, Moment):
            return {"moment": asdict(result)}, None
        if call == "schema":
            layouts = {p: list(held.names) for p, held in self.stream.layouts.items()}
            signals = [asdict(s) for s in result]
            return {"signals": signals, "layout": self.stream.layout, "blocks": layouts}, None
        return moment | {"result": result}, None


def _read(query: Any) -> tuple[dict[str, Any], bytes]:
    payload, attached = query.payload, query.attachment
    for what, read in (("message", payload), ("block of numbers", attached)):
        if read is not None and len(read) > (most := MOST_BYTES[what]):
            raise InputInvalid(f"a {what} of {len(read)} bytes; expected at most {most}")
    message = read_message(b"" if payload is None else payload.to_bytes())
    return message, b"" if attached is None else attached.to_bytes()


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
    """Find a port that nobody listens on; raises InputInvalid for a host of others."""
    import socket

    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as s:
        try:
            s.bind((host, 0))
        except OSError as error:
            raise InputInvalid(
                f"cannot listen at {host}: {error.strerror}; expected an address of this machine"
            ) from None
        return int(s.getsockname()[1])
