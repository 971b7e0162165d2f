"""Clients that have joined over Zenoh: each call proves its client, and has its client's thread.

Zenoh does not reveal the sender of a query. A client that joins therefore gets a secret, its proof,
which it sends with each call. Answers are sent by one thread for each client, so that a client
which does not read its answers delays no other.
"""

from __future__ import annotations

import contextlib
import hmac
import queue
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import final

from uuvsim_cosim.bridge.access.authentication import Authenticator, everybody
from uuvsim_cosim.bridge.access.zenoh_permissions import READER, reader_password
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.closing import started
from uuvsim_cosim.errors import InputInvalid

__all__ = ["MOST_BYTES", "AnswerQueue", "JoinedClients"]

MOST_BYTES = {"message": 1 << 20, "block of numbers": 8 << 20}  # the limits of the TCP server
_CLIENTS = 64
_WAITING = 64  # calls of one client that wait for their answer
_REFUSALS = 64  # further calls that are refused with an error; those beyond are dropped
_PATIENCE = 5.0  # [s] that closing waits for the lanes; a client that does not read blocks one


@final
class AnswerQueue:
    """The queue and the thread that sends the answers of one client, one after another."""

    def __init__(self, name: str) -> None:
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._waiting = 0
        self._lock = threading.Lock()
        self._name = name
        self._thread: threading.Thread | None = None
        self._closed = False

    def count_in(self) -> bool | None:
        """Count a call: return True to carry it out, False to refuse it, None to drop it."""
        with self._lock:
            if self._waiting >= _WAITING + _REFUSALS:
                return None
            self._waiting += 1
            return self._waiting <= _WAITING

    def put(self, work: Callable[[], None]) -> None:
        """Queue the work for a call that was counted; after `close` it is not done any more."""
        with self._lock:
            if self._closed:
                return
            if self._thread is None:
                self._thread = started(f"uuvsim-zenoh-{self._name}", self._run)
            self._work.put(work)

    def close(self) -> None:
        """End the thread once the queued work is done."""
        with self._lock:
            self._closed = True
            self._work.put(None)

    def has_ended(self, timeout: float = 0.0) -> bool:
        """Wait at most `timeout` s for the end of the thread; return whether it has ended."""
        if self._thread is not None:
            self._thread.join(max(0.0, timeout))
        return self._thread is None or not self._thread.is_alive()

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            with contextlib.suppress(Exception):  # the client has disconnected
                work()
            del work  # and with it the query, which Zenoh then ends
            with self._lock:
                self._waiting -= 1


@dataclass(frozen=True)
class _Joined:
    client: Client
    lane: AnswerQueue
    proof: str


@final
class JoinedClients:
    """The clients that have joined, and the common client of those that have not."""

    def __init__(self, authenticator: Authenticator | None) -> None:
        self._authenticator = authenticator
        self._admit = authenticator or everybody
        self._joined: dict[str, _Joined] = {}
        self._ending: list[AnswerQueue] = []  # of clients that have left; they may still be working
        self._lock = threading.Lock()
        self.guests, self._joining = AnswerQueue("guests"), AnswerQueue("joining")
        self.reader = reader_password()

    def lane(self, call: str, message: Mapping[str, object]) -> AnswerQueue:
        """Return the lane of a call; joining, which takes long, has one for all clients."""
        if call in ("join", "leave"):
            return self._joining
        joined = self._joined.get(str(message.get("client", "")))
        return self.guests if joined is None or not self._proven(joined, message) else joined.lane

    def client(self, call: str, message: Mapping[str, object]) -> Client:
        """Return the client of a call; raises InputInvalid if it has not joined but must."""
        token = str(message.get("client", ""))
        with self._lock:
            joined = self._joined.get(token)
        if joined is None and token:
            raise InputInvalid(call, "this client has not joined, or was removed", "to join first")
        if joined is None:
            shown = _text(call, message, "token")
            return Client("zenoh", "zenoh", self._admit(None, None, self._shown, shown))
        if not self._proven(joined, message):
            raise InputInvalid(
                f"{call}: expected the `proof` that the server returned when this client joined"
            )
        return joined.client

    def allowed(self, message: Mapping[str, object], certificate: str | None) -> frozenset[str]:
        """Return the permissions of a client that joins; raises InputInvalid to refuse it."""
        token = str(message.get("client", ""))
        if not token or "/" in token or token in self._joined or len(token) > 64:
            raise InputInvalid("join", f"client {token[:64]!r}", "an id of its own")
        if len(self._joined) >= _CLIENTS:
            raise InputInvalid(f"join: {_CLIENTS} clients have joined, the maximum")
        user, password, shown = (_text("join", message, k) for k in ("user", "password", "token"))
        named = self._shown if certificate is None else certificate
        return self._admit(user, password, named, shown)

    def enter(self, message: Mapping[str, object], client: Client) -> dict[str, object]:
        """Add a client that the service has joined; return the fields of its answer."""
        token, proof = str(message["client"]), secrets.token_urlsafe(24)
        joined = _Joined(
            client, AnswerQueue(client.name), proof if self._authenticator is not None else ""
        )
        with self._lock:
            self._joined[token] = joined
        answer: dict[str, object] = {"allowed": sorted(client.allowed)}
        if self._authenticator is not None:
            answer["proof"] = proof
            if "read" in client.allowed:
                answer["reader"] = [READER, self.reader]
        return answer

    def leave(self, token: str) -> Client | None:
        """Remove a client; return it if it had joined."""
        with self._lock:
            joined = self._joined.pop(token, None)
            if joined is None:
                return None
            running = [lane for lane in self._ending if not lane.has_ended()]
            self._ending = [*running, joined.lane]
        joined.lane.close()
        return joined.client

    def close(self) -> None:
        """Remove all clients, and wait for the lanes to end.

        Python ends daemon threads when they wait for its lock; inside Zenoh that aborts the program
        ("exception not rethrown"). No lane may therefore be inside Zenoh when Python ends.
        """
        for token in list(self._joined):
            self.leave(token)
        self.guests.close()
        self._joining.close()
        latest = time.monotonic() + _PATIENCE
        for lane in (self.guests, self._joining, *self._ending):
            lane.has_ended(latest - time.monotonic())

    @property
    def _shown(self) -> str | None:
        """Return "" if Zenoh has verified a certificate; Zenoh does not reveal its name here."""
        tls = None if self._authenticator is None else self._authenticator.access.tls
        return None if tls is None or tls.ca is None else ""

    @staticmethod
    def _proven(joined: _Joined, message: Mapping[str, object]) -> bool:
        return hmac.compare_digest(joined.proof.encode(), str(message.get("proof", "")).encode())


def _text(call: str, message: Mapping[str, object], field: str) -> str | None:
    read = message.get(field)
    if read is not None and not isinstance(read, str):
        raise InputInvalid(call, f"{field} is no text", "one")
    return read
