"""Clients that have joined over Zenoh: each call proves its client, whose answers are kept for it.

Zenoh does not say who asks, so a client that joins is given a proof which it sends with each call.
Answers leave by a thread for each client: one that does not take its own holds nobody up.
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
from typing import Any, final

from uuvsim_cosim.bridge.access.authentication import Authenticator, everybody
from uuvsim_cosim.bridge.access.zenoh import READER, reader_password
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.errors import InputInvalid

__all__ = ["MOST_BYTES", "JoinedClients", "Lane"]

MOST_BYTES = {"message": 1 << 20, "block of numbers": 8 << 20}  # as the TCP server reads
_CLIENTS = 64
_WAITING = 64  # calls of one client that wait for their answer
_REFUSALS = 64  # more of them are told so; those beyond are dropped
_PATIENCE = 5.0  # [s] that closing waits for the lanes; a client that takes nothing blocks one


@final
class Lane:
    """The answers of one client leave one after another, in a thread of their own."""

    def __init__(self, name: str) -> None:
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._waiting = 0
        self._lock = threading.Lock()
        self._name = name
        self._thread: threading.Thread | None = None
        self._closed = False

    def take(self) -> bool | None:
        """Count a call in: True if it may be asked, False if it is to be refused, None: dropped."""
        with self._lock:
            if self._waiting >= _WAITING + _REFUSALS:
                return None
            self._waiting += 1
            return self._waiting <= _WAITING

    def put(self, work: Callable[[], None]) -> None:
        """Let a call that was counted in be answered; after `close` nobody waits for the answer."""
        with self._lock:
            if self._closed:
                return
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name=f"uuvsim-zenoh-{self._name}", daemon=True
                )
                self._thread.start()
            self._work.put(work)

    def close(self) -> None:
        """End after what waits still."""
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
            with contextlib.suppress(Exception):  # whoever asked is gone
                work()
            del work  # with its query, which Zenoh answers as over
            with self._lock:
                self._waiting -= 1


@dataclass(frozen=True)
class _Joined:
    client: Client
    lane: Lane
    proof: str


@final
class JoinedClients:
    """The clients that have joined, and those who have not."""

    def __init__(self, authenticator: Authenticator | None) -> None:
        self._authenticator = authenticator
        self._admit = authenticator or everybody
        self._joined: dict[str, _Joined] = {}
        self._left: list[Lane] = []  # of clients that have left; what waited there may be under way
        self._lock = threading.Lock()
        self.guests, self._joining = Lane("guests"), Lane("joining")
        self.reader = reader_password()

    def lane(self, call: str, message: Mapping[str, Any]) -> Lane:
        """Return the lane of who asks; that who joins does what takes long as well."""
        if call in ("join", "leave"):
            return self._joining
        joined = self._joined.get(str(message.get("client", "")))
        return self.guests if joined is None or not self._proven(joined, message) else joined.lane

    def client(self, call: str, message: Mapping[str, Any]) -> Client:
        """Return who asks; raises InputInvalid if it has not joined where it must."""
        token = str(message.get("client", ""))
        with self._lock:
            joined = self._joined.get(token)
        if joined is None and token:
            raise InputInvalid(
                f"{call}: this client has not joined, or was let go; expected to join first"
            )
        if joined is None:
            shown = _text(call, message, "token")
            return Client("zenoh", "zenoh", self._admit(None, None, self._shown, shown))
        if not self._proven(joined, message):
            raise InputInvalid(
                f"{call}: expected the `proof` that this client was given on joining"
            )
        return joined.client

    def allowed(self, message: Mapping[str, Any], certificate: str | None) -> frozenset[str]:
        """Return what one who joins may do; raises InputInvalid in words if it may not enter."""
        token = str(message.get("client", ""))
        if not token or "/" in token or token in self._joined or len(token) > 64:
            raise InputInvalid(f"join: client {token[:64]!r}; expected an id of its own")
        if len(self._joined) >= _CLIENTS:
            raise InputInvalid(f"join: {_CLIENTS} clients have joined, which is all that may")
        user, password, shown = (_text("join", message, k) for k in ("user", "password", "token"))
        named = self._shown if certificate is None else certificate
        return self._admit(user, password, named, shown)

    def enter(self, message: Mapping[str, Any], client: Client) -> dict[str, Any]:
        """Enter a client that the service has joined; gives what it is told beside its name."""
        token, proof = str(message["client"]), secrets.token_urlsafe(24)
        joined = _Joined(
            client, Lane(client.name), proof if self._authenticator is not None else ""
        )
        with self._lock:
            self._joined[token] = joined
        told: dict[str, Any] = {"allowed": sorted(client.allowed)}
        if self._authenticator is not None:
            told["proof"] = proof
            if "read" in client.allowed:
                told["reader"] = [READER, self.reader]
        return told

    def leave(self, token: str) -> Client | None:
        """Let a client go; gives it if it had joined."""
        with self._lock:
            joined = self._joined.pop(token, None)
            if joined is None:
                return None
            self._left = [*(lane for lane in self._left if not lane.has_ended()), joined.lane]
        joined.lane.close()
        return joined.client

    def close(self) -> None:
        """Let all go, and wait for the lanes to end.

        Python ends daemon threads where they ask for its lock; inside Zenoh that aborts the program
        ("exception not rethrown"), so no lane may be there when Python ends.
        """
        for token in list(self._joined):
            self.leave(token)
        self.guests.close()
        self._joining.close()
        latest = time.monotonic() + _PATIENCE
        for lane in (self.guests, self._joining, *self._left):
            lane.has_ended(latest - time.monotonic())

    @property
    def _shown(self) -> str | None:
        """Return "" where Zenoh has verified a certificate whose name it does not tell."""
        tls = None if self._authenticator is None else self._authenticator.access.tls
        return None if tls is None or tls.ca is None else ""

    @staticmethod
    def _proven(joined: _Joined, message: Mapping[str, Any]) -> bool:
        return hmac.compare_digest(joined.proof.encode(), str(message.get("proof", "")).encode())


def _text(call: str, message: Mapping[str, Any], field: str) -> str | None:
    read = message.get(field)
    if read is not None and not isinstance(read, str):
        raise InputInvalid(f"{call}: {field} is no text; expected one")
    return read
