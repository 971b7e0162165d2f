"""The Zenoh server: calls are queries, states are blocks, and liveliness shows who is connected.

The keys are in `bridge/calls/zenoh_keys.py`.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from uuvsim_cosim._version import __version__
from uuvsim_cosim.bridge.access.authentication import Authenticator
from uuvsim_cosim.bridge.access.token import TokenFile, guarded_by_token
from uuvsim_cosim.bridge.access.zenoh_permissions import guarded
from uuvsim_cosim.bridge.calls.call_table import CALLS, arguments, checked, read_object
from uuvsim_cosim.bridge.calls.service import Client, Moment, Schema
from uuvsim_cosim.bridge.calls.time_sharing import READS
from uuvsim_cosim.bridge.calls.values import json_of
from uuvsim_cosim.bridge.calls.zenoh_keys import (
    call_key,
    certificate_key,
    client_key,
    component_key,
    master_key,
    state_key,
)
from uuvsim_cosim.bridge.server.call_queue import Answer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.zenoh.codec import (
    PROTOCOL,
    message_of,
    packed,
    unpacked,
)
from uuvsim_cosim.bridge.zenoh.joined_clients import MOST_BYTES, JoinedClients
from uuvsim_cosim.bridge.zenoh.session import PORT, listening
from uuvsim_cosim.bridge.zenoh.shared_memory import SharedMemory
from uuvsim_cosim.bridge.zenoh.stream import Stream
from uuvsim_cosim.closing import Owner, close_at_exit
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.system import System

if TYPE_CHECKING:
    import zenoh

__all__ = ["Bridge"]

_EACH = ("client", "proof", "binary", "token")  # in a message, in addition to a call's fields
_JOIN = ("protocol", "version", "user", "password")  # the same, of `join` only
_ANSWER = 48 << 20  # bytes of a recorded run: Zenoh's messages have at most 64 MiB
_JSON, _BLOCK = "application/json", "application/octet-stream;uuvsim-state"


@final
class Bridge(Owner):
    """Server of a running co-simulation over Zenoh, by default on this machine only.

    `system` is a system, the name of one that ships, the file of a system or of a recording, a
    plan, or a master that is not initialized. The co-simulation waits at time 0 until a client
    steps or runs it. It ends when the bridge is closed, by `close` or at the end of a `with`. A
    `Conductor` can be served, too; it continues after that.

    The server listens at `host`, one address or several, and `port`. Port 0 is any free one, which
    the attribute `port` then holds. Clients need the token of this user, which `connect` finds on
    this machine. With `access`, clients authenticate themselves. With `anyone`, every client that
    reaches the port may do everything, which includes running code as this user. With
    `shared_memory`, large blocks reach clients on this machine by shared memory. `conducting` are
    options of the co-simulation: `seed`, `backend` ("native" or "fmu"), `record` (a folder for
    recordings), `fail_safe` ("drop", "pause" or "go-on": the reaction to a client in lockstep that
    is late or gone), and `loads_code` (False: no client may replace a component).

    Raises InputInvalid if it cannot listen there, and SystemInvalid for an invalid system.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> bridge = uuv.Bridge(boat, port=0)
    >>> with uuv.connect(port=bridge.port) as client:
    ...     client.step(10, {"hull.tau": [50, 0, 0, 0, 0, 0]}, ["hull.nu[1]"])  # N; m/s after 1 s
    {'hull.nu[1]': 0.548...}
    >>> bridge.close()
    """

    def __init__(
        self,
        system: Conductor | System | Plan | Master | str | Path,
        *,
        port: int = PORT,
        host: str | Sequence[str] = "127.0.0.1",
        access: Authenticator | None = None,
        anyone: bool = False,
        shared_memory: bool = True,
        **conducting: Any,
    ) -> None:
        self.hosts = (host,) if isinstance(host, str) else tuple(host)
        self.host = self.hosts[0]
        if access is None and not anyone:
            access = guarded_by_token()
        self._joined = JoinedClients(access)
        rules = None if access is None else access.access
        self.tls = rules is not None and rules.tls is not None
        self._guests: dict[Client, Client] = {}
        self._waiting: dict[str, Answer] = {}  # the last run or step call of each client
        # The callbacks run in the opposite order, also if one of them raises: stream, token file,
        # session, co-simulation, lanes.
        with self._opening() as ending:
            ending.callback(self._joined.close)
            owned = ending.enter_context(contextlib.ExitStack())
            with guarded(rules, self._joined.reader) as settings:
                settings = {"transport/shared_memory/enabled": shared_memory, **settings}
                self._session = listening(port, self.hosts, settings, tls=self.tls)
            self.port = self._session.port
            ending.callback(self._session.close)
            ending.callback(TokenFile(access, self.port).close)
            if not isinstance(system, Conductor):
                system = owned.enter_context(Conductor(system, **conducting))
            self.conductor = system
            self.stream = Stream(
                lambda path: self._session.publisher(state_key(self._name, path), _BLOCK),
                SharedMemory(wanted=shared_memory),
            )
            ending.callback(self._end_stream)
            self._serve()
        close_at_exit(self)

    # ---- inside ---------------------------------------------------------------------------

    def _end_stream(self) -> None:
        with contextlib.suppress(InputInvalid):  # the co-simulation has ended already
            self.conductor.unwatch(self.stream)
        self.stream.end()

    def _serve(self) -> None:
        """Declare the keys: calls before `live/master`, as clients connect once that is alive."""
        described = self.conductor.describe()
        self._tick = Fraction(str(described["tick"]))
        self._schema: tuple[Schema | None, int, str] = (None, 0, "")
        self._name = str(described["system"])
        session = self._session
        self.conductor.watch(self.stream)
        self._answering = [
            session.answer(call_key(self._name), self._asked),
            session.answer(certificate_key(self._name), self._asked),
        ]
        self._watching = session.watch(client_key(self._name), self._lives)
        paths = [c["path"] for c in described["components"]]
        keys = [master_key(self._name), *(component_key(self._name, path) for path in paths)]
        self._tokens = [session.token(key) for key in keys]

    def _lives(self, key: str, lives: bool) -> None:
        """Remove a client that has disconnected; abort the run or the steps that it waits for."""
        if lives:
            return
        token = key.rpartition("/")[2]
        if (waiting := self._waiting.pop(token, None)) is not None:
            self.conductor.abandon(waiting)
        client = self._joined.leave(token)
        if client is not None:
            with contextlib.suppress(InputInvalid):  # the co-simulation has ended already
                self.conductor.ask("lost", client)

    def _asked(self, query: zenoh.Query) -> None:
        """Start a call, or refuse it; every answer is sent in the client's lane.

        It runs in Zenoh's thread, and must not wait: other queries would wait, too.
        """
        *_, way, name = str(query.key_expr).split("/")
        # A client joins with its certificate by the key of that name: Zenoh lets only the owner of
        # the certificate send queries to it.
        call, certificate = ("join", name) if way == "certificate" else (name, None)
        wrong: Exception | None = None
        message: dict[str, Any] = {}
        begun = time.thread_time()
        try:
            payload, attached = query.payload, query.attachment
            for what, read in (("message", payload), ("block of numbers", attached)):
                if read is not None and len(read) > (most := MOST_BYTES[what]):
                    raise InputInvalid(f"a {what} of {len(read)} bytes", f"at most {most}")
            message = read_object(b"" if payload is None else payload.to_bytes(), "message")
            block = b"" if attached is None else attached.to_bytes()
        except Exception as error:
            wrong = error
        lane = self._joined.lane(call, message)
        accepted = lane.count_in()
        if accepted is None:
            query.drop()
            return
        try:
            if wrong is not None:
                raise wrong
            if not accepted:
                raise InputInvalid(call, "too many calls are pending", "fewer")
            if call == "join":
                lane.put(lambda: self._join(query, message, certificate))
                return
            client = self._joined.client(call, message)
            if client.answer_bytes is None:  # all that have not joined are one client
                client = replace(client, answer_bytes=_ANSWER)
                client = self._guests.setdefault(client, client)
            turn = self.conductor.share.turn(client) if call in READS else None
            if turn is not None:
                lane.put(lambda: self._delayed(client, query, call, message, block, turn))
                return
            answer = self._asking(client, call, message, block)
        except Exception as error:
            lane.put(partial(_refuse, query, error))
            return
        finally:
            spent = time.thread_time() - begun
        reply = partial(self._reply, query, call, message, client, spent)

        def answered(done: Answer) -> None:
            """Let the lane send it: the conductor's thread, which runs this, must not wait."""
            moment = self.conductor.moment()
            lane.put(lambda: reply(moment, done))

        answer.add_done_callback(answered)

    def _asking(
        self, client: Client, call: str, message: Mapping[str, object], block: bytes
    ) -> Answer:
        """Put a call in the conductor's queue; raises InputInvalid for wrong arguments."""
        request = {k: v for k, v in message.items() if k not in _EACH}
        values = CALLS[call].values if call in CALLS else None
        if values is not None and isinstance(request.get(values), dict):
            request[values] = unpacked(request[values], block)
        given = arguments(call, request, lambda: self._tick, lambda: self.conductor.moment().tick)
        token = str(message.get("client", ""))
        if call == "leave":
            self._joined.leave(token)
        answer = self.conductor.ask(call, client, *given)

        def release(done: Answer) -> None:  # it may be large
            if self._waiting.get(token) is done:
                self._waiting.pop(token, None)

        if call in ("run", "step"):
            self._waiting[token] = answer
            answer.add_done_callback(release)
        return answer

    def _delayed(
        self,
        client: Client,
        query: zenoh.Query,
        call: str,
        message: Mapping[str, object],
        block: bytes,
        turn: float,
    ) -> None:
        """Make a reading call at its turn while others step, in the lane of its client."""
        self.conductor.share.wait(client, turn)
        try:
            answer = self._asking(client, call, message, block)
            concurrent.futures.wait([answer])
        except Exception as error:
            _refuse(query, error)
        else:
            self._reply(query, call, message, client, 0.0, self.conductor.moment(), answer)

    def _join(
        self, query: zenoh.Query, message: Mapping[str, object], certificate: str | None
    ) -> None:
        """Add a client; this runs in the lane for joining, as checking a password takes 40 ms."""
        try:
            theirs, version = message.get("protocol", PROTOCOL), message.get("version", "unknown")
            if theirs != PROTOCOL:
                raise InputInvalid(
                    f"the client (uuvsim-cosim {version}) uses protocol {theirs}",
                    f"protocol {PROTOCOL}, that of this server (uuvsim-cosim {__version__})",
                )
            fields = {k: v for k, v in message.items() if k not in (*_EACH, *_JOIN)}
            wishes = checked("join", fields)
            allowed = self._joined.allowed(message, certificate)
            wanted = Client(wishes.get("name", "zenoh"), "zenoh", allowed, _ANSWER)
            lockstep, lag = wishes.get("lockstep", False), wishes.get("lag", 5.0)
            client = self.conductor.join(wanted, lockstep=lockstep, lag=lag)
            answer = {
                "moment": asdict(self.conductor.moment()), "name": client.name,
                "protocol": PROTOCOL, "version": __version__, **self._joined.enter(message, client),
            }  # fmt: skip
            query.reply(query.key_expr, json.dumps(answer), express=True, encoding=_JSON)
        except Exception as error:
            _refuse(query, error)
        finally:
            query.drop()

    def _reply(
        self,
        query: zenoh.Query,
        call: str,
        message: Mapping[str, object],
        client: Client,
        spent: float,
        moment: Moment,
        done: Answer,
    ) -> None:
        """Send an answer; `spent` is the processor time [s] that its call has used before."""
        error = done.exception()
        if error is not None:
            _refuse(query, error)
            return
        begun = time.thread_time()
        try:
            text, block = self._encoded(call, message, done.result(), moment)
            query.reply(
                query.key_expr, text, attachment=block or None, express=True, encoding=_JSON
            )
        except Exception as wrong:  # without an answer, the client would wait without limit
            _refuse(query, wrong)
        finally:
            query.drop()
            if call in READS:
                self.conductor.share.took(client, spent + time.thread_time() - begun)

    def _encoded(
        self, call: str, message: Mapping[str, object], result: Any, at: Moment
    ) -> tuple[str, bytes]:
        """Return the answer in JSON, and the block of its numbers."""
        if call == "schema":
            known, layout, text = self._schema
            if known is not result or layout != self.stream.layout:  # built once per replacement
                layout = self.stream.layout
                blocks = {p: list(one.names) for p, one in self.stream.layouts.items()}
                rest = json.dumps({"layout": layout, "blocks": blocks})
                text = f'{{"signals": {result.text}, {rest[1:]}'
                self._schema = (result, layout, text)
            return text, b""
        if call == "step":
            at, result = result
        if isinstance(result, Moment):
            return json.dumps({"moment": asdict(result)}), b""
        answer: dict[str, object] = {"moment": asdict(at)}
        block = b""
        if call not in ("get", "step", "run"):
            answer["result"] = result
        elif message.get("binary"):
            answer["values"], block = packed(result)
        else:
            answer["values"] = json_of(result)
        return json.dumps(answer), block


def _refuse(query: zenoh.Query, error: BaseException) -> None:
    with contextlib.suppress(Exception):  # the client has disconnected
        query.reply_err(json.dumps(message_of(error)), encoding=_JSON)
        query.drop()
