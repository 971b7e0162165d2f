"""Requests over TCP or HTTP: each becomes a call of the service, and its result an answer."""

from __future__ import annotations

import json
import select
import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import Any, TypeVar

from uuvsim_cosim.bridge.calls.call_table import arguments
from uuvsim_cosim.bridge.calls.service import Client, Service, SignalInfo
from uuvsim_cosim.bridge.calls.values import json_of
from uuvsim_cosim.bridge.tcp.framing import Disconnected
from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["Answer", "Calls", "failure"]

_LOOK = 0.2  # [s] between two checks whether a client that waits for steps is still connected

_T = TypeVar("_T")


@dataclass(frozen=True)
class Answer:
    """The result of a call: JSON for the header, and values of variables.

    `text` is the header without its braces, for a header whose JSON exists already.
    """

    header: Mapping[str, object]
    values: Mapping[str, Any]
    text: str = ""

    @property
    def header_text(self) -> str:
        """Return the header in JSON, with `ok`, without the brace at its end."""
        if self.text:
            return f'{{"ok": true, {self.text}'
        return json.dumps({"ok": True, **self.header}, ensure_ascii=False)[:-1]


class Calls:
    """The calls of one client; keeps the schema, which `replace` changes."""

    def __init__(self, service: Service, client: Client) -> None:
        self.service = service
        self.client = client
        self._tick: Fraction | None = None
        self._thread = threading.local()
        self.refresh()

    def attended(self, connection: socket.socket) -> None:
        """Abort later calls of this thread once the other end closes its connection."""
        self._thread.connection = connection

    def waited(self, call: str, *arguments: object) -> Any:
        """Carry out a call that may take long; raises Disconnected if its client disconnects."""
        connection: socket.socket | None = getattr(self._thread, "connection", None)
        answer = self.service.ask(call, self.client, *arguments)
        while True:
            try:
                return answer.result(_LOOK)
            except TimeoutError:
                if answer.done():  # the call itself has raised TimeoutError
                    raise
            if connection is not None and _hung_up(connection):
                self.service.abandon(answer)
                raise Disconnected(f"{call}: the client has disconnected")

    @property
    def tick(self) -> Fraction:
        """The communication step [s], which no call changes."""
        if self._tick is None:
            self._tick = Fraction(str(self.service.describe()["tick"]))
        return self._tick

    @property
    def schema(self) -> Mapping[str, SignalInfo]:
        """All variables by name."""
        return self._schema.by_name

    def refresh(self) -> bool:
        """Read the schema again; return whether it has changed."""
        before, schema = getattr(self, "_schema", None), self.service.schema()
        if schema is before:
            return False
        self._schema = schema
        return before is not None and list(before) != list(self._schema)

    def knowing(self, work: Callable[[], _T]) -> _T:
        """Return `work()`, which looks up names; try again if a component has been replaced."""
        try:
            return work()
        except InputInvalid:
            if not self.refresh():
                raise
            return work()

    def answer(self, name: object, request: Mapping[str, object]) -> Answer:
        """Carry out a call with the fields of a request.

        Raises UuvsimError for an invalid request and for a call that fails.
        """
        given = arguments(name, request, lambda: self.tick, lambda: self.service.moment().tick)
        assert isinstance(name, str)
        match name:
            case "describe":
                described = json_of(self.service.describe())
                return Answer({"system": described, **asdict(self.service.moment())}, {})
            case "schema":
                self.refresh()
                return Answer({}, {}, f'"signals": {self._schema.text}')
            case "step":
                moment, found = self.waited("step", *given)
                return Answer(asdict(moment), found)
            case "run":
                found = self.waited("run", *given)
                return Answer(asdict(self.service.moment()), found)
            case "get":
                found = self.service.get(self.client, *given)
                return Answer(asdict(self.service.moment()), found)
            case "snapshot":
                kept = self.service.snapshot(self.client)
                return Answer({"snapshot": kept, **asdict(self.service.moment())}, {})
            case "join" | "leave":
                raise InputInvalid(name, "this connection has joined", "another call")
        moment = getattr(self.service, name)(self.client, *given)
        if name == "replace":
            self.refresh()
        return Answer(asdict(moment), {})


def failure(error: BaseException) -> dict[str, object]:
    """Return the answer that reports an error."""
    if isinstance(error, UuvsimError):
        return {"ok": False, "error": str(error), "kind": type(error).__name__}
    return {
        "ok": False,
        "error": f"unexpected {type(error).__name__}: {error}; this is a mistake in "
        "uuvsim-cosim, please report it with the output of `uuvsim doctor`",
        "kind": "Unexpected",
    }


def _hung_up(client: socket.socket) -> bool:
    """Return whether the other end has closed its connection; received data stays unread."""
    try:
        poll = select.poll() if hasattr(select, "poll") else None
        if poll is not None:
            poll.register(client, select.POLLIN)
            if not poll.poll(0):
                return False
        elif not select.select([client], [], [], 0.0)[0]:
            return False
        return not socket.socket.recv(client, 1, socket.MSG_PEEK)  # below TLS, which cannot peek
    except (OSError, ValueError):
        return True
